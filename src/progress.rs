//! Progress bars on standard error; silent where that is not a terminal.

use indicatif::{ProgressBar, ProgressStyle};

const TEMPLATE: &str = "{prefix:>16} {bar:30} {pos}/{len} {msg} {eta} left";

/// A bar that counts to `total` under a short title, with the time that is left.
pub fn bar(title: &str, total: u64) -> ProgressBar {
    let style = ProgressStyle::with_template(TEMPLATE).unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(total).with_style(style).with_prefix(title.to_owned())
}

/// One bar after the other for work that goes through stages.
pub struct StageBars {
    current: Option<(String, ProgressBar)>,
    subject: String,
}

impl StageBars {
    /// No bar yet; `subject` stands beside every one.
    pub fn about(subject: impl Into<String>) -> StageBars {
        StageBars { current: None, subject: subject.into() }
    }

    /// Shows that `done` of `all` parts of `stage` are done; a new stage replaces the bar.
    pub fn show(&mut self, stage: &str, done: u64, all: u64) {
        if self.current.as_ref().is_none_or(|(shown, _)| shown != stage) {
            self.clear();
            self.current = Some((stage.to_owned(), bar(stage, all).with_message(self.subject.clone())));
        }
        if let Some((_, bar)) = &self.current {
            bar.set_length(all);
            bar.set_position(done);
            bar.tick();
        }
    }

    /// Takes the bar away.
    pub fn clear(&mut self) {
        if let Some((_, bar)) = self.current.take() {
            bar.finish_and_clear();
        }
    }
}
