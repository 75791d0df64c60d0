//! How a window slides: the attributes that convolutions and pools have in common, and numbers of any element type.

use std::borrow::Cow;

use vitruvian_reference::nn::{Scalar, Tensor, same_padding};

use super::{Attributes, Call, Data, Value, room};
use crate::onnx::element::ElementType;

/// The longest kernel, stride, dilation or padding: longer ones than any axis can be are mistakes or mischief.
const LONGEST: usize = 1 << 24;

/// Kernel, stride, dilation and padding of each spatial axis.
pub(super) struct Window {
    pub kernel: Vec<usize>,
    pub stride: Vec<usize>,
    pub dilation: Vec<usize>,
    pub padding: Vec<[usize; 2]>,
}

impl Window {
    /// The window that the attributes describe over an image of these lengths; `kernel` is that of the weights where there are some.
    pub fn of(attributes: Attributes, image: &[usize], kernel: Option<&[usize]>) -> Result<Self, String> {
        let axes = image.len();
        let counts = |name: &str, default: usize| {
            let counts = attributes.counts(name, axes, default)?;
            match counts.iter().find(|&&count| count > LONGEST) {
                Some(count) => {
                    Err(format!("attribute \"{name}\" has {count}, at most {LONGEST} was expected"))
                }
                None => Ok(counts),
            }
        };
        let said = counts("kernel_shape", 0)?;
        let kernel = match kernel {
            Some(is) if attributes.has("kernel_shape") && said != is => {
                return Err(format!("attribute \"kernel_shape\" is {said:?}, the weights have {is:?}"));
            }
            Some(is) => is.to_vec(),
            None => said,
        };
        let (stride, dilation) = (counts("strides", 1)?, counts("dilations", 1)?);
        let padding = match attributes.text("auto_pad", "NOTSET")? {
            "NOTSET" => attributes.paddings(axes)?,
            auto if attributes.integers("pads").is_some_and(|pads| pads.iter().any(|&pad| pad != 0)) => {
                return Err(format!(
                    "attribute \"auto_pad\" is {auto} beside \"pads\", one of them was expected"
                ));
            }
            "VALID" => vec![[0, 0]; axes],
            "SAME_UPPER" => same_padding(image, &kernel, &stride, &dilation, true),
            "SAME_LOWER" => same_padding(image, &kernel, &stride, &dilation, false),
            other => return Err(format!("attribute \"auto_pad\" is {other}, which is not understood")),
        };
        if let Some(pads) = padding.iter().find(|pads| pads.iter().any(|&pad| pad > LONGEST)) {
            return Err(format!("attribute \"pads\" has {pads:?}, at most {LONGEST} was expected"));
        }
        let window = Self { kernel, stride, dilation, padding };
        window.extents()?;
        Ok(window)
    }

    /// Pixels that the window spans along each axis.
    fn extents(&self) -> Result<Vec<usize>, String> {
        let extent = |(&kernel, &dilation): (&usize, &usize)| Some((kernel.checked_sub(1)?) * dilation + 1);
        let all: Option<Vec<usize>> = self.kernel.iter().zip(&self.dilation).map(extent).collect();
        let positive = all.filter(|_| self.stride.iter().chain(&self.dilation).all(|&count| count > 0));
        positive.ok_or_else(|| {
            let Self { kernel, stride, dilation, .. } = self;
            format!("kernel {kernel:?}, strides {stride:?} and dilations {dilation:?} must be positive")
        })
    }

    /// Refuses more outputs than there is room for.
    pub fn room(&self, maps: [usize; 2], image: &[usize]) -> Result<(), String> {
        let extents = self.extents()?;
        let outputs = (0..image.len()).map(|a| {
            let padded = image[a] + self.padding[a][0] + self.padding[a][1];
            padded.saturating_sub(extents[a]) / self.stride[a] + 2
        });
        room(&[&maps[..], &outputs.collect::<Vec<_>>()].concat())
    }

    /// Refuses more outputs of the adjoint than there is room for.
    pub fn transposed_room(&self, maps: [usize; 2], image: &[usize], more: &[usize]) -> Result<(), String> {
        let extents = self.extents()?;
        let outputs = (0..image.len()).map(|a| image[a] * self.stride[a] + extents[a] + more[a]);
        room(&[&maps[..], &outputs.collect::<Vec<_>>()].concat())
    }
}

/// The shape [N,C,…] in its parts.
pub(super) fn image<T: Copy>(x: &Tensor<T>) -> Result<([usize; 2], &[usize]), String> {
    match x.shape[..] {
        [samples, channels, _, ..] => Ok(([samples, channels], &x.shape[2..])),
        _ => Err(format!("operand 0 has shape {:?}, [N,C,spatial…] was expected", x.shape)),
    }
}

/// Operand `i` as numbers, whatever its element type.
///
/// Integers up to 2⁵³ are numbers without error.
pub(super) fn any_numbers<'a, T: Scalar>(call: &Call<'a, T>, i: usize) -> Result<Cow<'a, Tensor<T>>, String> {
    match &call.operand(i)?.data {
        Data::Numbers(x) => Ok(Cow::Borrowed(x)),
        Data::Integers(x) => match x.data.iter().find(|k| k.unsigned_abs() > 1 << 53) {
            Some(large) => Err(format!("operand {i} has the integer {large}, which is no f64")),
            None => Ok(Cow::Owned(x.map(|k| T::exact(k as f64)))),
        },
        Data::Truths(_) => Err(format!("operand {i} holds truths, numbers were expected")),
    }
}

/// How numbers become integers.
#[derive(Clone, Copy)]
pub(super) enum ToInteger {
    /// To the nearest, the even one half way.
    Nearest,
    /// Towards zero, as C converts.
    TowardsZero,
}

/// Numbers as a value of any element type; integers saturate at the ends of theirs.
pub(super) fn value_of<T: Scalar>(
    element: ElementType,
    numbers: Tensor<T>,
    to_integer: ToInteger,
) -> Result<Value<T>, String> {
    let Some((least, most)) = element.range() else {
        return Ok(Value::from_numbers(element, numbers));
    };
    let integer = |x: T| {
        let whole = match to_integer {
            ToInteger::Nearest => x.value().round_ties_even(),
            ToInteger::TowardsZero => x.value().trunc(),
        };
        (whole as i128).clamp(least, most) as i64
    };
    Value::from_integers(element, numbers.map(integer))
}
