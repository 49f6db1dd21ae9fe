//! Solid ground of maps in the engine's form. Building the triangles' hierarchy is the slowest part
//! of loading a map, so the last few maps are cached.

use std::collections::{BTreeSet, HashMap};
use std::sync::Arc;

use rapier3d::math::Vector;
use rapier3d::prelude::{ColliderBuilder, SharedShape};

use schema_types::{Class, ObjectId};

use crate::map_data::{LoadError, MapData};

/// A mesh with its hierarchy.
#[derive(Clone)]
pub(crate) struct Solid {
    pub shape: SharedShape,
    /// Its class; [`Class::UNLABELED`] if that of each triangle says more.
    pub class: Class,
    /// Class of each triangle of `shape`.
    pub triangle_classes: Arc<[Class]>,
}

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
    let classes = TriangleClasses::new(map);
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
        solids.push(Solid {
            shape: collider.shape,
            class: mesh.class,
            triangle_classes: classes.of(mesh_idx, &BTreeSet::new()),
        });
    }
    Ok(solids)
}

/// Classes of a map's solid triangles: their mesh's, or their object's if the mesh has none.
pub(super) struct TriangleClasses<'a> {
    map: &'a MapData,
    of_object: HashMap<ObjectId, Class>,
}

impl<'a> TriangleClasses<'a> {
    pub fn new(map: &'a MapData) -> Self {
        let of_object = map.objects.iter().map(|o| (o.id, o.class)).collect();
        TriangleClasses { map, of_object }
    }

    /// One for each triangle of a mesh whose object is not hidden, in their order.
    pub fn of(&self, mesh_idx: usize, hidden: &BTreeSet<ObjectId>) -> Arc<[Class]> {
        let mesh = &self.map.collision[mesh_idx];
        let objects = self.map.objects_of(mesh_idx).unwrap_or_default();
        if objects.is_empty() {
            return vec![mesh.class; mesh.triangles.len()].into();
        }
        let shown = objects.iter().filter(|object| !hidden.contains(object));
        let class = |object| match mesh.class {
            Class::UNLABELED => self.of_object.get(object).copied().unwrap_or_default(),
            class => class,
        };
        shown.map(class).collect()
    }
}
