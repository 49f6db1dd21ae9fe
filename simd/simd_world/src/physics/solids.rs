//! Solid ground of maps in the engine's form. Building the triangles' hierarchy is the slowest part
//! of loading a map, so the last few maps are cached.

use std::sync::Arc;

use rapier3d::math::Vector;
use rapier3d::prelude::{ColliderBuilder, SharedShape};

use schema_types::Class;

use crate::map_data::{LoadError, MapData};

/// A mesh with its hierarchy, and its class.
pub(crate) type Solid = (SharedShape, Class);

/// Number of maps in the cache.
const KEPT: usize = 3;

/// Cached solids of the maps that were loaded last.
#[derive(Clone, Default)]
pub(crate) struct Solids {
    kept: Vec<(Arc<MapData>, Vec<Solid>)>,
}

impl Solids {
    /// Solids of this map: cached if the same `Arc` was asked for lately.
    ///
    /// # Errors
    /// [`LoadError::Collision`] for a mesh that cannot be used.
    pub fn of(&mut self, map: &Arc<MapData>) -> Result<Vec<Solid>, LoadError> {
        if let Some((_, solids)) = self.kept.iter().find(|(kept, _)| Arc::ptr_eq(kept, map)) {
            return Ok(solids.clone());
        }
        let solids = solids(map)?;
        if self.kept.len() >= KEPT {
            self.kept.remove(0);
        }
        self.kept.push((map.clone(), solids.clone()));
        Ok(solids)
    }
}

fn solids(map: &MapData) -> Result<Vec<Solid>, LoadError> {
    let unusable = |mesh_idx, reason| LoadError::Collision {
        map: map.name.clone(),
        mesh_idx,
        reason,
    };
    let mut solids = Vec::new();
    for (mesh_idx, mesh) in map.collision.iter().enumerate() {
        if mesh.triangles.is_empty() {
            continue;
        }
        if mesh.vertices_m.iter().flatten().any(|x| !x.is_finite()) {
            return Err(unusable(
                mesh_idx,
                "has a corner that is not finite".to_owned(),
            ));
        }
        let n_vertices = mesh.vertices_m.len() as u32;
        if let Some(corner) = mesh
            .triangles
            .iter()
            .flatten()
            .find(|corner| **corner >= n_vertices)
        {
            return Err(unusable(
                mesh_idx,
                format!("names corner {corner} but has only {n_vertices}"),
            ));
        }
        let vertices = mesh.vertices_m.iter().map(|v| Vector::from(*v)).collect();
        let collider = ColliderBuilder::trimesh(vertices, mesh.triangles.clone())
            .map_err(|error| unusable(mesh_idx, error.to_string()))?;
        solids.push((collider.shape, mesh.class));
    }
    Ok(solids)
}
