//! A common factor or addend, of the output or of an operand, whatever made it: fitted.

use vitruvian_reference::nn::Rounded;

use super::change::{exact, numbers, output_numbers};
use super::fit::Parameter;
use super::trial::Trial;

pub(super) fn parameters(trial: &Trial) -> Vec<Parameter> {
    let mut all = vec![
        Parameter::new(
            "scale",
            1.0,
            |factor| format!("the output is {factor} times what it should be"),
            |factor| output_numbers(move |y| y * exact(factor)),
        ),
        Parameter::new(
            "offset",
            0.0,
            |addend| format!("the output is what it should be and {addend}"),
            |addend| {
                output_numbers(move |y: Rounded| {
                    let sum = y + exact(addend);
                    Rounded { magnitude: sum.magnitude.max(y.magnitude), ..sum }
                })
            },
        ),
    ];
    for (place, name) in trial.node().input.iter().enumerate().take(5) {
        // One number that is scaled is another number: exponents, bounds and slopes have families of their own.
        if trial.numbers(place).is_some_and(|x| !x.is_empty()) {
            let (of, by) = (name.clone(), name.clone());
            all.push(Parameter::new(
                "scale",
                1.0,
                move |factor| format!("operand {place} (\"{of}\") was {factor} times what it should be"),
                move |factor| numbers(place, move |x| x * factor),
            ));
            all.push(Parameter::new(
                "offset",
                0.0,
                move |addend| format!("operand {place} (\"{by}\") was what it should be and {addend}"),
                move |addend| numbers(place, move |x| x + addend),
            ));
        }
    }
    all
}
