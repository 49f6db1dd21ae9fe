//! What a result is: the type that its topic declares, and the numbers for pixels, elements and
//! spaces in its header.

macro_rules! numbered {
    ($(#[$doc:meta])* $name:ident { $($(#[$variant_doc:meta])* $variant:ident = $code:literal, $text:literal $(, $bytes:literal)?;)* }) => {
        $(#[$doc])*
        #[repr(u16)]
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
        pub enum $name { $($(#[$variant_doc])* $variant = $code,)* }

        impl $name {
            /// All of them in the order of their numbers.
            pub const ALL: &[$name] = &[$($name::$variant,)*];

            /// The one with this number, if there is one.
            pub fn from_code(code: u16) -> Option<Self> {
                Self::ALL.iter().copied().find(|it| *it as u16 == code)
            }

            /// Name in files, attributes and Python.
            pub const fn name(self) -> &'static str {
                match self { $($name::$variant => $text,)* }
            }

            /// The one with this name, if there is one.
            pub fn from_name(name: &str) -> Option<Self> {
                Self::ALL.iter().copied().find(|it| it.name() == name)
            }
        }

        numbered!(@bytes $name $($variant $($bytes)?;)*);
    };
    (@bytes $name:ident $($variant:ident $bytes:literal;)*) => {
        impl $name {
            /// Size of one, bytes.
            pub const fn element_bytes(self) -> usize {
                match self { $($name::$variant => $bytes,)* }
            }
        }
    };
    (@bytes $name:ident $($variant:ident;)*) => {};
}

numbered! {
    /// Type of a result: what the topic's attribute `gantry.result` names. The number is
    /// [`crate::ResultHeader::result_type`].
    ResultType {
        /// `height × width` pixels of any [`PixelFormat`].
        Image = 1, "image";
        /// An array of one [`ElementType`] with up to 8 dimensions, last index fastest.
        Tensor = 2, "tensor";
        /// List of [`crate::Box2d`].
        Boxes2d = 3, "boxes2d";
        /// List of [`crate::Box3d`].
        Boxes3d = 4, "boxes3d";
        /// List of [`crate::Track`].
        Tracks = 5, "tracks";
        /// List of [`crate::MaskRecord`], then their runs as `u32`.
        Masks = 6, "masks";
        /// List of [`crate::KeypointSet`], then their [`crate::Keypoint`]s.
        Keypoints = 7, "keypoints";
        /// Optical flow in the encoding of the modality `flow`.
        Flow = 8, "flow";
        /// Depth in the encoding of the modality `depth`.
        Depth = 9, "depth";
        /// Classes in the encoding of the modality `semantic`.
        Semantic = 10, "semantic";
        /// Object ids in the encoding of the modality `instance`.
        Instance = 11, "instance";
        /// Point cloud whose fields the topic's description names.
        Points = 12, "points";
        /// One [`crate::PoseEstimate`].
        Pose = 13, "pose";
        /// One [`crate::Odometry`].
        Odometry = 14, "odometry";
        /// List of [`crate::PathPoint`].
        Path = 15, "path";
        /// List of [`crate::VehicleControlRecord`]: what a planner wants, for those who look;
        /// the simulator obeys `control/vehicles`.
        Control = 16, "control";
        /// List of [`crate::Scalar`]: named numbers.
        Scalars = 17, "scalars";
        /// UTF-8.
        Text = 18, "text";
        /// One JSON value, UTF-8.
        Json = 19, "json";
        /// Bytes of an encoding and a schema of the user's own, which the topic's description
        /// names.
        Bytes = 20, "bytes";
    }
}

numbered! {
    /// How a result's pixels are laid out. The numbers below 32 are those of the modality with the
    /// same bytes.
    PixelFormat {
        /// B G R A `u8`, sRGB: the modality `rgb`.
        Bgra8 = 1, "bgra8", 4;
        /// `f32` metres along the optical axis: the modality `depth`.
        Depth = 2, "depth", 4;
        /// `u8` class number: the modality `semantic`.
        Class = 3, "class", 1;
        /// `u32` id: the modality `instance`.
        Id = 4, "id", 4;
        /// `f32` × 2 pixels: the modality `flow`.
        Flow = 5, "flow", 8;
        /// `f16` × 4: the modality `normals`.
        Normals = 6, "normals", 8;
        /// B G R `u8`, sRGB.
        Bgr8 = 32, "bgr8", 3;
        /// R G B `u8`, sRGB.
        Rgb8 = 33, "rgb8", 3;
        /// R G B A `u8`, sRGB.
        Rgba8 = 34, "rgba8", 4;
        /// One `u8`.
        Mono8 = 35, "mono8", 1;
        /// One `u16`.
        Mono16 = 36, "mono16", 2;
        /// One `f32`.
        Mono32f = 37, "mono32f", 4;
    }
}

numbered! {
    /// Type of a tensor's elements, or of a point's field.
    ElementType {
        /// Unsigned, 8 bits.
        U8 = 1, "u8", 1;
        /// Signed, 8 bits.
        I8 = 2, "i8", 1;
        /// Unsigned, 16 bits.
        U16 = 3, "u16", 2;
        /// Signed, 16 bits.
        I16 = 4, "i16", 2;
        /// Unsigned, 32 bits.
        U32 = 5, "u32", 4;
        /// Signed, 32 bits.
        I32 = 6, "i32", 4;
        /// Unsigned, 64 bits.
        U64 = 7, "u64", 8;
        /// Signed, 64 bits.
        I64 = 8, "i64", 8;
        /// Floating point, 16 bits.
        F16 = 9, "f16", 2;
        /// Floating point, 32 bits.
        F32 = 10, "f32", 4;
        /// Floating point, 64 bits.
        F64 = 11, "f64", 8;
        /// A byte: 0 is false, everything else true.
        Bool = 12, "bool", 1;
    }
}

numbered! {
    /// Which space a result's numbers are in.
    Space {
        /// It has none: texts, scalars.
        None = 0, "none";
        /// Pixels of the image that it answers.
        Image = 1, "image";
        /// The space of the sensor whose frame it answers.
        Sensor = 2, "sensor";
        /// The space of the vehicle that carries this sensor.
        Vehicle = 3, "vehicle";
        /// The world.
        World = 4, "world";
    }
}

impl ResultType {
    /// All names, for a sentence.
    pub fn names() -> String {
        let names: Vec<&str> = Self::ALL.iter().map(|it| it.name()).collect();
        names.join(", ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Modality;

    #[test]
    fn pixels_below_32_have_number_and_size_of_their_modality() {
        for format in PixelFormat::ALL {
            let modality = Modality::from_code(*format as u16);
            assert_eq!(modality.is_some(), (*format as u16) < 32, "{format:?}");
            if let Some(modality) = modality {
                assert_eq!(modality.element_bytes(), format.element_bytes());
                assert!(modality.is_image());
            }
        }
    }

    #[test]
    fn names_and_numbers_lead_back_to_the_same_type() {
        for kind in ResultType::ALL.iter().copied() {
            assert_eq!(ResultType::from_name(kind.name()), Some(kind));
            assert_eq!(ResultType::from_code(kind as u16), Some(kind));
        }
        assert_eq!(ResultType::from_name("boxes"), None);
        assert_eq!(ResultType::from_code(0), None);
    }
}
