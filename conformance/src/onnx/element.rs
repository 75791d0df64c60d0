//! The types of a tensor's elements: ONNX's numbers for them, and what a float type can hold.

use std::fmt;

/// Element types that are read here.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum ElementType {
    /// IEEE binary32.
    F32,
    /// IEEE binary64.
    F64,
    /// IEEE binary16.
    F16,
    /// The upper half of a binary32: 8 bits of exponent, 7 of fraction.
    Bf16,
    /// 8-bit integer.
    I8,
    /// 8-bit integer without sign.
    U8,
    /// 16-bit integer.
    I16,
    /// 16-bit integer without sign.
    U16,
    /// 32-bit integer.
    I32,
    /// 32-bit integer without sign.
    U32,
    /// 64-bit integer.
    I64,
    /// 64-bit integer without sign.
    U64,
    /// A truth.
    Bool,
}

/// A float type: p digits of significand, and the exponents e of its normal numbers 2ᵉ·1.xxx.
struct Format {
    digits: i32,
    smallest: i32,
    largest: i32,
}

impl ElementType {
    /// All of them.
    pub const ALL: [Self; 13] = [
        Self::F32,
        Self::F64,
        Self::F16,
        Self::Bf16,
        Self::I8,
        Self::U8,
        Self::I16,
        Self::U16,
        Self::I32,
        Self::U32,
        Self::I64,
        Self::U64,
        Self::Bool,
    ];

    /// The type with this number in ONNX's `TensorProto.DataType`, or `None` for a type that is not read here.
    pub fn from_number(number: i32) -> Option<Self> {
        Self::ALL.into_iter().find(|element| element.number() == number)
    }

    /// ONNX's number.
    pub fn number(self) -> i32 {
        match self {
            Self::F32 => 1,
            Self::U8 => 2,
            Self::I8 => 3,
            Self::U16 => 4,
            Self::I16 => 5,
            Self::I32 => 6,
            Self::I64 => 7,
            Self::Bool => 9,
            Self::F16 => 10,
            Self::F64 => 11,
            Self::U32 => 12,
            Self::U64 => 13,
            Self::Bf16 => 16,
        }
    }

    /// Bytes per element.
    pub fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 | Self::Bool => 1,
            Self::F16 | Self::Bf16 | Self::I16 | Self::U16 => 2,
            Self::F32 | Self::I32 | Self::U32 => 4,
            Self::F64 | Self::I64 | Self::U64 => 8,
        }
    }

    /// Whether it is a float type.
    pub fn is_float(self) -> bool {
        self.format().is_some()
    }

    /// The smallest and the largest integer of an integer type; `None` for floats and truths.
    pub fn range(self) -> Option<(i128, i128)> {
        match self {
            Self::I8 => Some((i8::MIN.into(), i8::MAX.into())),
            Self::U8 => Some((0, u8::MAX.into())),
            Self::I16 => Some((i16::MIN.into(), i16::MAX.into())),
            Self::U16 => Some((0, u16::MAX.into())),
            Self::I32 => Some((i32::MIN.into(), i32::MAX.into())),
            Self::U32 => Some((0, u32::MAX.into())),
            Self::I64 => Some((i64::MIN.into(), i64::MAX.into())),
            Self::U64 => Some((0, u64::MAX.into())),
            Self::F32 | Self::F64 | Self::F16 | Self::Bf16 | Self::Bool => None,
        }
    }

    fn format(self) -> Option<Format> {
        match self {
            Self::F32 => Some(Format { digits: 24, smallest: -126, largest: 127 }),
            Self::F64 => Some(Format { digits: 53, smallest: -1022, largest: 1023 }),
            Self::F16 => Some(Format { digits: 11, smallest: -14, largest: 15 }),
            Self::Bf16 => Some(Format { digits: 8, smallest: -126, largest: 127 }),
            _ => None,
        }
    }

    /// u = 2⁻ᵖ of a float type, the largest relative error of one rounding to nearest.
    pub fn unit_roundoff(self) -> Option<f64> {
        self.format().map(|format| power_of_two(-format.digits))
    }

    /// The smallest positive number of a float type that keeps all its digits.
    pub fn smallest_normal(self) -> Option<f64> {
        self.format().map(|format| power_of_two(format.smallest))
    }

    /// The smallest positive number of a float type.
    pub fn smallest_subnormal(self) -> Option<f64> {
        self.format().map(|format| power_of_two(format.smallest - format.digits + 1))
    }

    /// The largest finite number of a float type.
    pub fn largest(self) -> Option<f64> {
        self.format().map(|format| (2.0 - power_of_two(1 - format.digits)) * power_of_two(format.largest))
    }

    /// The nearest number of a float type, of two equally near ones the even one: overflow gives an infinity, and what lies
    /// below the normal numbers keeps as many digits as are left there. An integer type leaves the number as it is.
    pub fn round(self, x: f64) -> f64 {
        let Some(format) = self.format().filter(|_| self != Self::F64 && x.is_finite() && x != 0.0) else {
            return x;
        };
        // The last digit's worth at this size; x / digit and its product with it are exact.
        let exponent = ((x.to_bits() >> 52) & 0x7ff) as i32 - 1023;
        let digit = power_of_two(exponent.max(format.smallest) - format.digits + 1);
        let rounded = (x / digit).round_ties_even() * digit;
        let beyond = rounded.abs() >= power_of_two(format.largest + 1);
        if beyond { f64::INFINITY.copysign(x) } else { rounded }
    }

    /// The nearest number of a float type to an integer.
    pub fn round_integer(self, i: i64) -> f64 {
        if self == Self::F64 || i.unsigned_abs() <= 1 << 53 {
            return self.round(i as f64);
        }
        // An f64 would round before the narrower type does. A last digit that is odd where any was cut off keeps what
        // decides the rounding.
        let (head, tail) = (i >> 11, i & 0x7ff);
        self.round((head | i64::from(tail != 0)) as f64 * 2048.0)
    }

    /// The integer that is left of `i` in the bits of an integer type; the floats and truths leave it as it is.
    ///
    /// # Errors
    /// When it is 2⁶³ or more, which no [`Value`](super::value::Value) holds.
    pub fn wrap(self, i: i64) -> Result<i64, String> {
        Ok(match self {
            Self::I8 => i64::from(i as i8),
            Self::U8 => i64::from(i as u8),
            Self::I16 => i64::from(i as i16),
            Self::U16 => i64::from(i as u16),
            Self::I32 => i64::from(i as i32),
            Self::U32 => i64::from(i as u32),
            Self::U64 if i < 0 => {
                return Err(format!("the u64 {} is beyond 2^63 - 1, the largest integer here", i as u64));
            }
            Self::U64 | Self::I64 | Self::F32 | Self::F64 | Self::F16 | Self::Bf16 | Self::Bool => i,
        })
    }
}

/// 2ᵏ for every k that an f64 holds.
fn power_of_two(k: i32) -> f64 {
    if k >= -1022 { f64::from_bits(((k + 1023) as u64) << 52) } else { f64::from_bits(1 << (k + 1074)) }
}

impl fmt::Display for ElementType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::F32 => "f32",
            Self::F64 => "f64",
            Self::F16 => "f16",
            Self::Bf16 => "bf16",
            Self::I8 => "i8",
            Self::U8 => "u8",
            Self::I16 => "i16",
            Self::U16 => "u16",
            Self::I32 => "i32",
            Self::U32 => "u32",
            Self::I64 => "i64",
            Self::U64 => "u64",
            Self::Bool => "bool",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_and_types_are_one_to_one() {
        for element in ElementType::ALL {
            assert_eq!(ElementType::from_number(element.number()), Some(element), "{element}");
        }
        for foreign in [0, 8, 14, 15, 17, 21, 22, 23, -1] {
            assert_eq!(ElementType::from_number(foreign), None, "{foreign}");
        }
    }

    #[test]
    fn what_a_float_type_holds_is_what_rust_says() {
        use ElementType::{Bf16, F16, F32, F64};
        assert_eq!(F32.smallest_normal(), Some(f64::from(f32::MIN_POSITIVE)));
        assert_eq!(F32.smallest_subnormal(), Some(f64::from(f32::from_bits(1))));
        assert_eq!(F32.largest(), Some(f64::from(f32::MAX)));
        assert_eq!(F64.smallest_normal(), Some(f64::MIN_POSITIVE));
        assert_eq!(F64.smallest_subnormal(), Some(f64::from_bits(1)));
        assert_eq!(F64.largest(), Some(f64::MAX));
        assert_eq!(F16.largest(), Some(65_504.0));
        assert_eq!(F16.smallest_subnormal(), Some(half::f16::from_bits(1).to_f64()));
        assert_eq!(Bf16.largest(), Some(half::bf16::MAX.to_f64()));
        assert_eq!(Bf16.unit_roundoff(), Some(1.0 / 256.0));
        assert_eq!(F16.unit_roundoff(), Some(1.0 / 2048.0));
    }

    #[test]
    fn rounding_is_to_the_nearest_and_to_the_even_of_two() {
        // Every f16 and every midpoint between neighbours, and what lies beside the midpoint.
        for bits in 0..0x7c00_u16 {
            let (low, high) = (half::f16::from_bits(bits), half::f16::from_bits(bits + 1));
            let (a, b) = (low.to_f64(), if bits == 0x7bff { 65_536.0 } else { high.to_f64() });
            let even = if bits % 2 == 0 { a } else { high.to_f64() };
            let middle = 0.5 * (a + b);
            assert_eq!(ElementType::F16.round(a), a, "{a} is an f16");
            assert_eq!(ElementType::F16.round(-middle), -even, "halfway between {a} and {b}");
            assert_eq!(ElementType::F16.round(middle.next_down()), a, "below {middle}");
            assert_eq!(ElementType::F16.round(middle.next_up()), high.to_f64(), "above {middle}");
        }
    }

    #[test]
    fn rounding_to_f32_is_the_processors() {
        let mut bits = 0x0123_4567_89ab_cdef_u64;
        for _ in 0..20_000 {
            bits = bits.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            // Exponents from below the subnormals of f32 to beyond its largest number.
            let exponent = 1023 - 160 + (bits >> 20) % 300;
            let x = f64::from_bits((bits & 0x800f_ffff_ffff_ffff) | (exponent << 52));
            assert_eq!(ElementType::F32.round(x).to_bits(), f64::from(x as f32).to_bits(), "{x:e}");
        }
        assert!(ElementType::F32.round(f64::NAN).is_nan());
        assert_eq!(ElementType::F32.round(-1e300), f64::NEG_INFINITY);
        assert_eq!(ElementType::F32.round(-0.0).to_bits(), (-0.0_f64).to_bits(), "the sign of zero stays");
    }

    #[test]
    fn an_integer_is_rounded_once() {
        for i in [0, 1, -7, (1 << 24) + 1, i64::MAX, i64::MIN, (1 << 62) + (1 << 38) + 1, -(1 << 60) - 1] {
            assert_eq!(ElementType::F32.round_integer(i), f64::from(i as f32), "{i}");
            assert_eq!(ElementType::F64.round_integer(i), i as f64, "{i}");
        }
        // 2⁶² + 2⁵⁴ is halfway between two bf16; one more decides it, and an f64 does not see the one.
        let above = (1_i64 << 62) + (1 << 54) + 1;
        assert_eq!(ElementType::Bf16.round_integer(above - 1), power_of_two(62));
        assert_eq!(ElementType::Bf16.round_integer(above), power_of_two(62) + power_of_two(55));
    }

    #[test]
    fn integers_wrap_to_their_type() {
        assert_eq!(ElementType::I8.wrap(200), Ok(-56));
        assert_eq!(ElementType::U8.wrap(-1), Ok(255));
        assert_eq!(ElementType::U32.wrap(1 << 32), Ok(0));
        assert_eq!(ElementType::I64.wrap(i64::MIN), Ok(i64::MIN));
        assert!(ElementType::U64.wrap(-1).expect_err("2^64 - 1").contains("18446744073709551615"));
    }
}
