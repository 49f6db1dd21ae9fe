//! How checkpoints write types of other crates that do not know serde: used with `#[serde(with =
//! "crate::serde_forms::…")]`.

use std::sync::Arc;

use nalgebra::{Isometry3, Vector3};
use schema_roads::walkable::stroll::Stroll;
use schema_types::Pose;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// A pose, bit for bit.
pub(crate) mod isometry {
    use super::*;

    pub(crate) fn serialize<S: Serializer>(
        pose: &Isometry3<f64>,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        Pose::from(*pose).serialize(serializer)
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Isometry3<f64>, D::Error> {
        Pose::deserialize(deserializer).map(|pose| pose.isometry())
    }
}

/// The way of a stroller, field by field.
#[derive(Serialize, Deserialize)]
#[serde(remote = "Stroll")]
pub(crate) struct StrollForm {
    path: Vec<([f64; 2], u32)>,
    next: usize,
    n_ways: u64,
    stuck_secs: f64,
    nearest_m: f64,
}

/// A value that copies of a world share, as if it were its own.
pub(crate) mod shared {
    use super::*;

    pub(crate) fn serialize<T: ?Sized + Serialize, S: Serializer>(
        value: &Arc<T>,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        T::serialize(value, serializer)
    }

    pub(crate) fn deserialize<'de, T, D>(deserializer: D) -> Result<Arc<T>, D::Error>
    where
        T: ?Sized + ToOwned<Owned: Deserialize<'de>>,
        D: Deserializer<'de>,
        Arc<T>: From<T::Owned>,
    {
        T::Owned::deserialize(deserializer).map(Arc::from)
    }
}

/// A map of such values.
pub(crate) mod shared_values {
    use std::collections::BTreeMap;

    use super::*;

    pub(crate) fn serialize<K: Serialize, V: Serialize, S: Serializer>(
        map: &BTreeMap<K, Arc<V>>,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        serializer.collect_map(map.iter().map(|(key, value)| (key, &**value)))
    }

    pub(crate) fn deserialize<'de, K, V, D>(
        deserializer: D,
    ) -> Result<BTreeMap<K, Arc<V>>, D::Error>
    where
        K: Ord + Deserialize<'de>,
        V: Deserialize<'de>,
        D: Deserializer<'de>,
    {
        let map = BTreeMap::<K, V>::deserialize(deserializer)?;
        Ok(map.into_iter().map(|(k, v)| (k, Arc::new(v))).collect())
    }
}

/// A vector.
pub(crate) mod vector {
    use super::*;

    pub(crate) fn serialize<S: Serializer>(
        vector: &Vector3<f64>,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        <[f64; 3]>::from(*vector).serialize(serializer)
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Vector3<f64>, D::Error> {
        <[f64; 3]>::deserialize(deserializer).map(Vector3::from)
    }
}

/// Plain records, as their bytes.
pub(crate) mod pods {
    use super::*;

    pub(crate) fn serialize<T: bytemuck::Pod, S: Serializer>(
        records: &[T],
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        serializer.serialize_bytes(bytemuck::cast_slice(records))
    }

    pub(crate) fn deserialize<'de, T: bytemuck::Pod, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Vec<T>, D::Error> {
        struct Bytes<T>(std::marker::PhantomData<T>);
        impl<T: bytemuck::Pod> serde::de::Visitor<'_> for Bytes<T> {
            type Value = Vec<T>;

            fn expecting(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                formatter.write_str("the bytes of whole records")
            }

            fn visit_bytes<E: serde::de::Error>(self, bytes: &[u8]) -> Result<Vec<T>, E> {
                if !bytes.len().is_multiple_of(size_of::<T>()) {
                    return Err(E::invalid_length(bytes.len(), &self));
                }
                Ok(bytemuck::pod_collect_to_vec(bytes))
            }
        }
        deserializer.deserialize_bytes(Bytes(std::marker::PhantomData))
    }
}
