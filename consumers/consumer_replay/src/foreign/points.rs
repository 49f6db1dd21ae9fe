//! Point clouds of other programs as ours: x, y, z, intensity and channel.

use consumer_forms::ros2::read as ros2;
use consumer_forms::ros2::read::Number;
use foxglove::messages as fox;
use foxglove::messages::packed_element_field::NumericType;
use schema_frames::LidarPoint;

use super::error::ForeignError;

fn of_foxglove(code: i32) -> Option<Number> {
    Some(match NumericType::try_from(code).ok()? {
        NumericType::Uint8 => Number::U8,
        NumericType::Int8 => Number::I8,
        NumericType::Uint16 => Number::U16,
        NumericType::Int16 => Number::I16,
        NumericType::Uint32 => Number::U32,
        NumericType::Int32 => Number::I32,
        NumericType::Float32 => Number::F32,
        NumericType::Float64 => Number::F64,
        NumericType::Unknown => return None,
    })
}

/// The number of a type at `at`; `None` if it lies beyond the end.
fn number(of: Number, bytes: &[u8], at: usize) -> Option<f64> {
    fn take<const N: usize>(bytes: &[u8], at: usize) -> Option<[u8; N]> {
        bytes.get(at..at.checked_add(N)?)?.try_into().ok()
    }
    Some(match of {
        Number::U8 => f64::from(u8::from_le_bytes(take(bytes, at)?)),
        Number::I8 => f64::from(i8::from_le_bytes(take(bytes, at)?)),
        Number::U16 => f64::from(u16::from_le_bytes(take(bytes, at)?)),
        Number::I16 => f64::from(i16::from_le_bytes(take(bytes, at)?)),
        Number::U32 => f64::from(u32::from_le_bytes(take(bytes, at)?)),
        Number::I32 => f64::from(i32::from_le_bytes(take(bytes, at)?)),
        Number::F32 => f64::from(f32::from_le_bytes(take(bytes, at)?)),
        Number::F64 => f64::from_le_bytes(take(bytes, at)?),
    })
}

/// A cloud as another program has it.
#[derive(Debug)]
pub struct Cloud {
    /// Bytes of a point.
    pub stride: usize,
    /// Name, offset in the point, type.
    pub fields: Vec<(String, usize, Number)>,
    pub data: Vec<u8>,
}

impl Cloud {
    pub fn of_foxglove(cloud: &fox::PointCloud) -> Cloud {
        let fields = cloud.fields.iter().filter_map(|field| {
            let number = of_foxglove(field.r#type)?;
            Some((field.name.clone(), field.offset as usize, number))
        });
        Cloud {
            stride: cloud.point_stride as usize,
            fields: fields.collect(),
            data: cloud.data.to_vec(),
        }
    }

    pub fn of_ros2(cloud: ros2::PointCloud) -> Cloud {
        let fields = cloud.fields.into_iter();
        Cloud {
            stride: cloud.stride,
            fields: fields.map(|it| (it.name, it.offset, it.number)).collect(),
            data: cloud.data,
        }
    }

    /// Writes its points; returns their number. Points that are not finite are left out.
    pub fn write(&self, out: &mut Vec<u8>) -> Result<u32, ForeignError> {
        let field = |names: &[&str]| {
            let mut fields = self.fields.iter();
            fields.find(|(name, ..)| names.contains(&name.as_str()))
        };
        let axes = [field(&["x"]), field(&["y"]), field(&["z"])];
        let [Some(x), Some(y), Some(z)] = axes else {
            return Err(ForeignError::NoAxes);
        };
        if self.stride == 0 {
            return Err(ForeignError::EmptyPoints);
        }
        let intensity = field(&["intensity", "i", "reflectivity"]);
        let channel = field(&["ring", "channel", "line"]);
        let mut n = 0u32;
        for point in self.data.chunks_exact(self.stride) {
            let read = |of: &(String, usize, Number)| number(of.2, point, of.1);
            let (Some(x), Some(y), Some(z)) = (read(x), read(y), read(z)) else {
                return Err(ForeignError::FieldBeyond);
            };
            if !(x.is_finite() && y.is_finite() && z.is_finite()) {
                continue;
            }
            let strength = intensity.map_or(0.0, |of| share(of.2, read(of).unwrap_or(0.0)));
            let point = LidarPoint {
                hit_in_sensor_m: [x as f32, y as f32, z as f32],
                intensity: (strength * 65_535.0).round() as u16,
                channel: channel.and_then(read).unwrap_or(0.0) as u16,
            };
            out.extend_from_slice(bytemuck::bytes_of(&point));
            n = n.saturating_add(1);
        }
        Ok(n)
    }
}

/// An intensity as a share of the greatest: whole numbers of their type's, others of 1 or, as many
/// drivers have it, of 255.
fn share(of: Number, value: f64) -> f64 {
    let greatest = match of {
        Number::U8 => 255.0,
        Number::U16 => 65_535.0,
        _ if value <= 1.0 => 1.0,
        _ => 255.0,
    };
    (value / greatest).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_of_any_layout_become_ours() {
        let mut data = Vec::new();
        for (z, ring, i) in [(3.0f32, 7u16, 128u8), (f32::NAN, 1, 1), (5.0, 9, 255)] {
            data.extend([1.0f32, 2.0].into_iter().flat_map(f32::to_le_bytes));
            data.extend(z.to_le_bytes());
            data.extend([i, 0]);
            data.extend(ring.to_le_bytes());
        }
        let cloud = Cloud {
            stride: 16,
            fields: vec![
                ("x".into(), 0, Number::F32),
                ("y".into(), 4, Number::F32),
                ("z".into(), 8, Number::F32),
                ("intensity".into(), 12, Number::U8),
                ("ring".into(), 14, Number::U16),
            ],
            data,
        };
        let mut out = Vec::new();
        assert_eq!(cloud.write(&mut out).unwrap(), 2);
        let last: LidarPoint = bytemuck::pod_read_unaligned(&out[16..]);
        assert_eq!(
            (last.hit_in_sensor_m, last.intensity, last.channel),
            ([1.0, 2.0, 5.0], 65_535, 9)
        );
        let broken = Cloud { stride: 8, ..cloud };
        assert!(
            broken
                .write(&mut out)
                .unwrap_err()
                .to_string()
                .contains("beyond its point")
        );
    }
}
