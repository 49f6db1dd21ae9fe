//! Messages of ROS 2 in CDR, as far as frames are made of them. Any bytes are safe to pass.

use schema_frames::ImuSample;

use super::picture::Picture;
use super::points::{Cloud, Number};

/// Reads values one after another; each begins at a multiple of its size.
struct Cdr<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Cdr<'a> {
    fn new(message: &'a [u8]) -> Result<Cdr<'a>, String> {
        match message {
            [0, 1, _, _, bytes @ ..] => Ok(Cdr { bytes, at: 0 }),
            _ => Err("its CDR is not little-endian".into()),
        }
    }

    fn take(&mut self, n: usize, align: usize) -> Result<&'a [u8], String> {
        let at = self.at.next_multiple_of(align);
        let end = at.checked_add(n).filter(|end| *end <= self.bytes.len());
        let end = end.ok_or("it ends early")?;
        self.at = end;
        Ok(&self.bytes[at..end])
    }

    fn u8(&mut self) -> Result<u8, String> {
        Ok(self.take(1, 1)?[0])
    }

    fn u16(&mut self) -> Result<u16, String> {
        let bytes = self.take(2, 2)?;
        Ok(u16::from_le_bytes([bytes[0], bytes[1]]))
    }

    fn u32(&mut self) -> Result<u32, String> {
        let bytes = self.take(4, 4)?;
        Ok(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]))
    }

    fn f64(&mut self) -> Result<f64, String> {
        let bytes = self.take(8, 8)?;
        Ok(f64::from_le_bytes(
            bytes.try_into().map_err(|_| "it ends early")?,
        ))
    }

    fn f64s<const N: usize>(&mut self) -> Result<[f64; N], String> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.f64()?;
        }
        Ok(values)
    }

    fn bytes(&mut self) -> Result<&'a [u8], String> {
        let n = self.u32()? as usize;
        self.take(n, 1)
    }

    /// A text with its closing zero.
    fn text(&mut self) -> Result<String, String> {
        let bytes = self.bytes()?;
        let text = bytes.strip_suffix(&[0]).unwrap_or(bytes);
        Ok(String::from_utf8_lossy(text).into_owned())
    }

    /// `std_msgs/msg/Header`; its name of the axes.
    fn header(&mut self) -> Result<String, String> {
        self.u32()?;
        self.u32()?;
        self.text()
    }
}

/// `sensor_msgs/msg/Image`.
pub fn image(message: &[u8]) -> Result<Picture, String> {
    let mut cdr = Cdr::new(message)?;
    let frame_id = cdr.header()?;
    let (height, width) = (cdr.u32()?, cdr.u32()?);
    let encoding = cdr.text()?;
    if cdr.u8()? != 0 {
        return Err("its pixels are big-endian".into());
    }
    Ok(Picture {
        frame_id,
        width,
        height,
        encoding,
        step: cdr.u32()?,
        data: cdr.bytes()?.to_vec(),
    })
}

/// `sensor_msgs/msg/CompressedImage`: name of the axes, and the file.
pub fn compressed_image(message: &[u8]) -> Result<(String, Vec<u8>), String> {
    let mut cdr = Cdr::new(message)?;
    let frame_id = cdr.header()?;
    cdr.text()?;
    Ok((frame_id, cdr.bytes()?.to_vec()))
}

/// `sensor_msgs/msg/PointCloud2`.
pub fn point_cloud(message: &[u8]) -> Result<Cloud, String> {
    let mut cdr = Cdr::new(message)?;
    cdr.header()?;
    cdr.u32()?;
    cdr.u32()?;
    let n_fields = cdr.u32()?;
    if n_fields > 256 {
        return Err(format!("its points have {n_fields} fields"));
    }
    let mut fields = Vec::new();
    for _ in 0..n_fields {
        let (name, offset) = (cdr.text()?, cdr.u32()? as usize);
        let number = match cdr.u8()? {
            1 => Some(Number::I8),
            2 => Some(Number::U8),
            3 => Some(Number::I16),
            4 => Some(Number::U16),
            5 => Some(Number::I32),
            6 => Some(Number::U32),
            7 => Some(Number::F32),
            8 => Some(Number::F64),
            _ => None,
        };
        cdr.u32()?;
        fields.extend(number.map(|number| (name, offset, number)));
    }
    if cdr.u8()? != 0 {
        return Err("its points are big-endian".into());
    }
    let stride = cdr.u32()? as usize;
    cdr.u32()?;
    Ok(Cloud {
        stride,
        fields,
        data: cdr.bytes()?.to_vec(),
    })
}

/// `sensor_msgs/msg/NavSatFix`: latitude and longitude in degrees, altitude in metres.
pub fn nav_sat_fix(message: &[u8]) -> Result<[f64; 3], String> {
    let mut cdr = Cdr::new(message)?;
    cdr.header()?;
    cdr.u8()?;
    cdr.u16()?;
    cdr.f64s::<3>()
}

/// `sensor_msgs/msg/Imu`. Its heading is that of the orientation, if it has one.
pub fn imu(message: &[u8]) -> Result<ImuSample, String> {
    let mut cdr = Cdr::new(message)?;
    cdr.header()?;
    let [x, y, z, w] = cdr.f64s::<4>()?;
    let covariance = cdr.f64s::<9>()?;
    let angular_velocity_radps = cdr.f64s::<3>()?;
    cdr.f64s::<9>()?;
    let specific_force_mps2 = cdr.f64s::<3>()?;
    // A first element of -1 says that there is no orientation.
    let yaw = (2.0 * (w * z + x * y)).atan2(1.0 - 2.0 * (y * y + z * z));
    let compass_rad = match covariance[0] == -1.0 || !yaw.is_finite() {
        true => 0.0,
        false => (std::f64::consts::FRAC_PI_2 - yaw).rem_euclid(std::f64::consts::TAU),
    };
    Ok(ImuSample {
        specific_force_mps2,
        angular_velocity_radps,
        compass_rad,
        ..bytemuck::Zeroable::zeroed()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Header with a name of three letters: 8 bytes of time, 4 of length, 4 of text.
    fn head() -> Vec<u8> {
        let mut bytes = vec![0, 1, 0, 0];
        bytes.extend([0; 8]);
        bytes.extend(4u32.to_le_bytes());
        bytes.extend(b"cam\0");
        bytes
    }

    #[test]
    fn an_image_and_a_motion_are_read() {
        let mut bytes = head();
        bytes.extend([2u32, 1].into_iter().flat_map(u32::to_le_bytes));
        bytes.extend(5u32.to_le_bytes());
        bytes.extend(b"rgb8\0");
        bytes.push(0);
        bytes.extend([0; 2]);
        bytes.extend(3u32.to_le_bytes());
        bytes.extend(6u32.to_le_bytes());
        bytes.extend([1, 2, 3, 4, 5, 6]);
        let found = image(&bytes).unwrap();
        assert_eq!((found.width, found.height, found.step), (1, 2, 3));
        assert_eq!(
            (found.frame_id.as_str(), found.encoding.as_str()),
            ("cam", "rgb8")
        );
        assert_eq!(found.data, [1, 2, 3, 4, 5, 6]);
        for cut in 0..bytes.len() {
            assert!(image(&bytes[..cut]).is_err(), "{cut}");
        }

        let mut bytes = head();
        // Half a turn about z, covariances, turning, covariances, force.
        let numbers = [0.0, 0.0, 1.0, 0.0].into_iter().chain([0.0; 9]);
        let numbers = numbers.chain([0.1, 0.2, 0.3]).chain([0.0; 9]);
        for number in numbers.chain([1.0, 2.0, 9.81]).chain([0.0; 9]) {
            bytes.extend(f64::to_le_bytes(number));
        }
        let found = imu(&bytes).unwrap();
        assert_eq!(found.specific_force_mps2, [1.0, 2.0, 9.81]);
        assert_eq!(found.angular_velocity_radps, [0.1, 0.2, 0.3]);
        assert!((found.compass_rad - 1.5 * std::f64::consts::PI).abs() < 1e-9);
    }

    #[test]
    fn random_bytes_never_panic() {
        let mut rng = fastrand::Rng::with_seed(3);
        for _ in 0..20_000 {
            let mut bytes = vec![0, 1, 0, 0];
            bytes.extend((0..rng.usize(..120)).map(|_| rng.u8(..) & rng.u8(..) & rng.u8(..)));
            let _ = (image(&bytes), compressed_image(&bytes), point_cloud(&bytes));
            let _ = (nav_sat_fix(&bytes), imu(&bytes));
        }
    }
}
