//! Types of messages with their hashes and fields. A hash is that of REP 2016 over the type's
//! description; the tests compute them again with another program.

use schema_recording::messages::SchemaText;

use super::definitions;

/// One type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Type {
    /// Its package.
    pub package: &'static str,
    /// Its name there.
    pub name: &'static str,
    /// Its hash; empty for the types that are only written into bags, which hold none.
    pub hash: &'static str,
}

impl Type {
    /// The name that goes over the wire.
    pub fn dds_name(&self) -> String {
        format!("{}::msg::dds_::{}_", self.package, self.name)
    }

    /// Full name, e.g. `sensor_msgs/msg/Image`.
    pub fn full_name(&self) -> String {
        format!("{}/msg/{}", self.package, self.name)
    }

    /// Its fields as ROS 2 declares them, then those of every type that they use, so that a reader of
    /// a bag needs no ROS installation.
    pub fn schema(&self) -> SchemaText {
        let text = definitions::text(&format!("{}/{}", self.package, self.name));
        SchemaText {
            name: self.full_name(),
            encoding: "ros2msg".into(),
            data: text.into_bytes(),
            message_encoding: "cdr".into(),
        }
    }
}

macro_rules! types {
    ($($constant:ident = $package:literal $name:literal $hash:literal;)*) => {
        $(
            #[doc = concat!("`", $package, "/msg/", $name, "`.")]
            pub const $constant: Type = Type {
                package: $package,
                name: $name,
                hash: $hash,
            };
        )*
    };
}

types! {
    IMAGE = "sensor_msgs" "Image" "RIHS01_d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47";
    COMPRESSED_IMAGE = "sensor_msgs" "CompressedImage" "RIHS01_15640771531571185e2efc8a100baf923961a4d15d5569652e6cb6691e8e371a";
    CAMERA_INFO = "sensor_msgs" "CameraInfo" "RIHS01_b3dfd68ff46c9d56c80fd3bd4ed22c7a4ddce8c8348f2f59c299e73118e7e275";
    POINT_CLOUD = "sensor_msgs" "PointCloud2" "RIHS01_9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5";
    IMU = "sensor_msgs" "Imu" "RIHS01_7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b";
    NAV_SAT_FIX = "sensor_msgs" "NavSatFix" "RIHS01_62223ab3fe210a15976021da7afddc9e200dc9ec75231c1b6a557fc598a65404";
    ODOMETRY = "nav_msgs" "Odometry" "RIHS01_3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0";
    TF = "tf2_msgs" "TFMessage" "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087";
    CLOCK = "rosgraph_msgs" "Clock" "RIHS01_692f7a66e93a3c83e71765d033b60349ba68023a8c689a79e48078bcb5c58564";
    DETECTIONS_2D = "vision_msgs" "Detection2DArray" "RIHS01_214274120007f4a683866481336b70310268cfa107aebe9d594a6acf75bda968";
    DETECTIONS_3D = "vision_msgs" "Detection3DArray" "RIHS01_793f5eab9595ac1c0da07873cc859db42eae51f0ee76056db8562515d830e018";
    ACKERMANN = "ackermann_msgs" "AckermannDrive" "RIHS01_acf287a224a947dd1b0b87d6d76cdb73f497b0237b8fc73be2173b2ebbb82c99";
    ACKERMANN_STAMPED = "ackermann_msgs" "AckermannDriveStamped" "RIHS01_48ca7612a08d3bb72744fd98b71b7cf2ea24c6ad50fa4e1aa0bbad963c90d8cf";
    VEHICLE_CONTROL = "carla_msgs" "CarlaEgoVehicleControl" "RIHS01_4f251fa2a554e8ed996f77eb1d5b65515af1369eceb04d5122cb5761f7801be3";
    VEHICLE_STATUS = "carla_msgs" "CarlaEgoVehicleStatus" "RIHS01_3565cc74470f5c37eb316a36426effd811ac1baf835df3fc2bb7a88574bb3e07";
    TEXT = "std_msgs" "String" "";
    EVENT_PACKET = "event_camera_msgs" "EventPacket" "";
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_schema_holds_every_type_that_it_uses_once() {
        let schema = DETECTIONS_3D.schema();
        assert_eq!(schema.name, "vision_msgs/msg/Detection3DArray");
        let text = String::from_utf8(schema.data).unwrap();
        for name in [
            "std_msgs/Header",
            "builtin_interfaces/Time",
            "vision_msgs/Detection3D",
            "vision_msgs/ObjectHypothesis",
            "geometry_msgs/Quaternion",
            "geometry_msgs/Vector3",
        ] {
            assert_eq!(text.matches(&format!("MSG: {name}\n")).count(), 1, "{name}");
        }
        assert!(!text.contains("MSG: vision_msgs/Detection3DArray"));
    }
}
