//! Messages of other programs, as far as frames are made of them. Any bytes are safe to pass.

use schema_frames::ImuSample;

use super::cdr::{ReadError, Reader};

/// Most fields that a point may have.
const MAX_FIELDS: u32 = 256;

/// `sensor_msgs/msg/Image`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    /// Name of its axes.
    pub frame_id: String,
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// Name of the encoding of its pixels.
    pub encoding: String,
    /// Bytes from one row to the next.
    pub step: u32,
    /// Its pixels.
    pub data: Vec<u8>,
}

/// `sensor_msgs/msg/CompressedImage`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CompressedImage {
    /// Name of its axes.
    pub frame_id: String,
    /// The image file.
    pub file: Vec<u8>,
}

/// Type of a number of a point, with its code in `sensor_msgs/msg/PointField`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Number {
    /// `int8`.
    I8 = 1,
    /// `uint8`.
    U8 = 2,
    /// `int16`.
    I16 = 3,
    /// `uint16`.
    U16 = 4,
    /// `int32`.
    I32 = 5,
    /// `uint32`.
    U32 = 6,
    /// `float32`.
    F32 = 7,
    /// `float64`.
    F64 = 8,
}

impl Number {
    fn from_code(code: u8) -> Option<Number> {
        use Number::{F32, F64, I8, I16, I32, U8, U16, U32};
        let all = [I8, U8, I16, U16, I32, U32, F32, F64];
        all.into_iter().find(|number| *number as u8 == code)
    }
}

/// A field of points whose type is known.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Field {
    /// Its name.
    pub name: String,
    /// Its place in a point, bytes.
    pub offset: usize,
    /// Its type.
    pub number: Number,
}

/// `sensor_msgs/msg/PointCloud2`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PointCloud {
    /// Bytes of a point.
    pub stride: usize,
    /// Its fields.
    pub fields: Vec<Field>,
    /// Its points.
    pub data: Vec<u8>,
}

/// Reads `std_msgs/msg/Header`: its name of the axes.
///
/// # Errors
/// [`ReadError::Short`].
pub fn header(reader: &mut Reader<'_>) -> Result<String, ReadError> {
    reader.i32()?;
    reader.u32()?;
    reader.text()
}

/// Reads `sensor_msgs/msg/Image`.
///
/// # Errors
/// [`ReadError`].
pub fn image(message: &[u8]) -> Result<Image, ReadError> {
    let mut cdr = Reader::new(message)?;
    let frame_id = header(&mut cdr)?;
    let (height, width) = (cdr.u32()?, cdr.u32()?);
    let encoding = cdr.text()?;
    if cdr.u8()? != 0 {
        return Err(ReadError::BigEndianPixels);
    }
    Ok(Image {
        frame_id,
        width,
        height,
        encoding,
        step: cdr.u32()?,
        data: cdr.sequence()?.to_vec(),
    })
}

/// Reads `sensor_msgs/msg/CompressedImage`.
///
/// # Errors
/// [`ReadError`].
pub fn compressed_image(message: &[u8]) -> Result<CompressedImage, ReadError> {
    let mut cdr = Reader::new(message)?;
    let frame_id = header(&mut cdr)?;
    cdr.text()?;
    Ok(CompressedImage {
        frame_id,
        file: cdr.sequence()?.to_vec(),
    })
}

/// Reads `sensor_msgs/msg/PointCloud2`. Fields of unknown types are left out.
///
/// # Errors
/// [`ReadError`].
pub fn point_cloud(message: &[u8]) -> Result<PointCloud, ReadError> {
    let mut cdr = Reader::new(message)?;
    header(&mut cdr)?;
    cdr.u32()?;
    cdr.u32()?;
    let n_fields = cdr.u32()?;
    if n_fields > MAX_FIELDS {
        return Err(ReadError::ManyFields(n_fields));
    }
    let mut fields = Vec::new();
    for _ in 0..n_fields {
        let (name, offset) = (cdr.text()?, cdr.u32()? as usize);
        let number = Number::from_code(cdr.u8()?);
        cdr.u32()?;
        fields.extend(number.map(|number| Field {
            name,
            offset,
            number,
        }));
    }
    if cdr.u8()? != 0 {
        return Err(ReadError::BigEndianPoints);
    }
    let stride = cdr.u32()? as usize;
    cdr.u32()?;
    Ok(PointCloud {
        stride,
        fields,
        data: cdr.sequence()?.to_vec(),
    })
}

/// Reads `sensor_msgs/msg/NavSatFix`: latitude and longitude in degrees, altitude in metres.
///
/// # Errors
/// [`ReadError`].
pub fn nav_sat_fix(message: &[u8]) -> Result<[f64; 3], ReadError> {
    let mut cdr = Reader::new(message)?;
    header(&mut cdr)?;
    cdr.u8()?;
    cdr.u16()?;
    cdr.f64s::<3>()
}

/// Reads `sensor_msgs/msg/Imu`. Its heading is that of the orientation, if it has one.
///
/// # Errors
/// [`ReadError`].
pub fn imu(message: &[u8]) -> Result<ImuSample, ReadError> {
    let mut cdr = Reader::new(message)?;
    header(&mut cdr)?;
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
