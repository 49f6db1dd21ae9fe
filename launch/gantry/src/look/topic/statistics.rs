//! Least, mean and greatest of numbers of any element type.

use half::f16;
use schema_frames::ElementType;
use serde_json::{Value, json};

/// Sums up numbers as they come.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Statistics {
    n: u64,
    n_not_finite: u64,
    sum: f64,
    range: Option<(f64, f64)>,
}

impl Statistics {
    /// Adds the elements in `bytes`.
    pub fn add(&mut self, of: ElementType, bytes: &[u8]) {
        for value in of_elements(of, bytes) {
            if !value.is_finite() {
                self.n_not_finite += 1;
                continue;
            }
            self.n += 1;
            self.sum += value;
            let (min, max) = self.range.unwrap_or((value, value));
            self.range = Some((min.min(value), max.max(value)));
        }
    }

    /// Adds `min`, `mean` and `max`, null without numbers, and how many are infinite or no number.
    pub fn into_object(self, object: &mut Value) {
        object["min"] = json!(self.range.map(|(min, _)| min));
        object["mean"] = json!((self.n > 0).then(|| self.sum / self.n as f64));
        object["max"] = json!(self.range.map(|(_, max)| max));
        object["n_not_finite"] = self.n_not_finite.into();
    }
}

/// The elements as `f64`; those of 64 bits are rounded to it.
pub fn of_elements(of: ElementType, bytes: &[u8]) -> impl Iterator<Item = f64> {
    bytes
        .chunks_exact(of.element_bytes())
        .filter_map(move |element| of_element(of, element))
}

fn of_element(of: ElementType, bytes: &[u8]) -> Option<f64> {
    Some(match of {
        ElementType::U8 => u8::from_le_bytes(bytes.try_into().ok()?) as f64,
        ElementType::I8 => i8::from_le_bytes(bytes.try_into().ok()?) as f64,
        ElementType::U16 => u16::from_le_bytes(bytes.try_into().ok()?) as f64,
        ElementType::I16 => i16::from_le_bytes(bytes.try_into().ok()?) as f64,
        ElementType::U32 => u32::from_le_bytes(bytes.try_into().ok()?) as f64,
        ElementType::I32 => i32::from_le_bytes(bytes.try_into().ok()?) as f64,
        ElementType::U64 => u64::from_le_bytes(bytes.try_into().ok()?) as f64,
        ElementType::I64 => i64::from_le_bytes(bytes.try_into().ok()?) as f64,
        ElementType::F16 => f16::from_le_bytes(bytes.try_into().ok()?).to_f64(),
        ElementType::F32 => f32::from_le_bytes(bytes.try_into().ok()?) as f64,
        ElementType::F64 => f64::from_le_bytes(bytes.try_into().ok()?),
        ElementType::Bool => (bytes.first()? != &0) as u8 as f64,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_element_type_is_read_as_little_endian_numbers() {
        let all = |of, bytes: &[u8]| of_elements(of, bytes).collect::<Vec<_>>();
        assert_eq!(all(ElementType::I8, &[255, 1]), [-1.0, 1.0]);
        assert_eq!(all(ElementType::U16, &[1, 2]), [513.0]);
        assert_eq!(all(ElementType::I32, &(-7i32).to_le_bytes()), [-7.0]);
        assert_eq!(all(ElementType::F64, &2.5f64.to_le_bytes()), [2.5]);
        assert_eq!(all(ElementType::Bool, &[0, 9]), [0.0, 1.0]);
        // 1, −2, the greatest, the least above zero, infinity.
        let halves = [0x3c00u16, 0xc000, 0x7bff, 0x0001, 0x7c00];
        let bytes: Vec<u8> = halves.iter().flat_map(|bits| bits.to_le_bytes()).collect();
        assert_eq!(
            all(ElementType::F16, &bytes),
            [1.0, -2.0, 65_504.0, 2f64.powi(-24), f64::INFINITY]
        );
        assert!(all(ElementType::F16, &0x7e00u16.to_le_bytes())[0].is_nan());
    }

    #[test]
    fn what_is_not_finite_is_counted_and_left_out() {
        let values = [1.0f32, f32::NAN, 4.0, f32::INFINITY, -2.0];
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        let mut statistics = Statistics::default();
        statistics.add(ElementType::F32, &bytes);
        let mut object = json!({});
        statistics.into_object(&mut object);
        assert_eq!(
            object,
            json!({"min": -2.0, "mean": 1.0, "max": 4.0, "n_not_finite": 2})
        );
        let mut nothing = json!({});
        Statistics::default().into_object(&mut nothing);
        assert!(nothing["mean"].is_null());
    }
}
