//! The reference's documented panics as errors.

use std::any::Any;
use std::cell::Cell;
use std::panic::{self, AssertUnwindSafe};
use std::sync::Once;

thread_local! {
    /// Whether a panic of this thread will be caught, so that nothing need be printed.
    static EXPECTED: Cell<bool> = const { Cell::new(false) };
}

/// What `f` gives, or what it says when it panics; nothing is printed.
pub(crate) fn caught<R>(f: impl FnOnce() -> R) -> Result<R, String> {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let previous = panic::take_hook();
        panic::set_hook(Box::new(move |info| {
            if !EXPECTED.get() {
                previous(info);
            }
        }));
    });
    let before = EXPECTED.replace(true);
    // Nothing outlives the panic that it could have left half done: `f` reads its operands and makes new tensors.
    let result = panic::catch_unwind(AssertUnwindSafe(f));
    EXPECTED.set(before);
    result.map_err(|payload| message(payload.as_ref()))
}

/// The text of a panic, in one line.
fn message(payload: &(dyn Any + Send)) -> String {
    let text = payload.downcast_ref::<String>().map(String::as_str);
    let text = text.or_else(|| payload.downcast_ref::<&str>().copied());
    text.unwrap_or("the reference refuses it without a word").lines().collect::<Vec<_>>().join("; ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_its_message_and_a_result_is_itself() {
        assert_eq!(caught(|| 7), Ok(7));
        let refused: Result<(), _> = caught(|| panic!("shape {:?}\nis too small", [1, 2]));
        assert_eq!(refused, Err("shape [1, 2]; is too small".into()));
        assert!(!EXPECTED.get(), "what panics later is printed again");
    }
}
