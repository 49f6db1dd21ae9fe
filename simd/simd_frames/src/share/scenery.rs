//! Still scenery by versions: who lacks a version asks for its list, and then only for the meshes
//! that it has not seen.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use anyhow::{Context as _, ensure};
use schema_types::{ObjectId, Pose};
use sensor_core::mesh::{Lod, Mesh, Vertex};
use sensor_core::scene::{LampSetting, MeshId, SceneAssets, StaticInstance};

use super::bytes::{Reader, Writer};

/// Bytes of meshes in one answer after which it ends, unless the first mesh alone is longer.
const ANSWER_BYTES: usize = 4 << 20;

/// The scenery at its source.
#[derive(Default)]
pub struct Scenery {
    assets: Option<Arc<SceneAssets>>,
    version: u64,
    /// Meshes by their place in memory, which stays theirs because they are held here.
    keys: BTreeMap<usize, (u64, Arc<Mesh>)>,
    by_key: BTreeMap<u64, Arc<Mesh>>,
    /// Version that the keys are those of.
    keyed: u64,
    next_key: u64,
}

impl Scenery {
    /// Version of these assets.
    pub fn version_of(&mut self, assets: &Arc<SceneAssets>) -> u64 {
        let is_known = self
            .assets
            .as_ref()
            .is_some_and(|known| Arc::ptr_eq(known, assets));
        if !is_known {
            self.assets = Some(assets.clone());
            self.version += 1;
        }
        self.version
    }

    /// The newest version: its number, what is where, and which meshes it needs.
    pub fn list(&mut self) -> Vec<u8> {
        self.give_keys();
        let mut to = Writer::default();
        to.put(self.version);
        let Some(assets) = &self.assets else {
            return to.0;
        };
        to.put(assets.episode);
        to.put(u8::from(assets.streamed));
        let key_of = |mesh: &Arc<Mesh>| self.keys.get(&place(mesh)).map_or(0, |(key, _)| *key);
        let keys: Vec<u64> = assets.meshes.iter().map(key_of).collect();
        to.put_all(&keys);
        to.put_len(assets.statics.len());
        for it in &assets.statics {
            to.put(it.mesh.0);
            to.put(Pose::from(it.world_from_mesh));
            to.put(it.object.0);
        }
        to.put_len(assets.switched.len());
        for (object, lamp) in &assets.switched {
            to.put(object.0);
            to.put(lamp.on.map_or(2u8, u8::from));
            to.put(u8::from(lamp.rgb.is_some()));
            to.put(lamp.rgb.unwrap_or_default());
            to.put(lamp.strength_ratio);
        }
        let hidden: Vec<u32> = assets.hidden.iter().map(|object| object.0).collect();
        to.put_all(&hidden);
        to.0
    }

    /// As many of these meshes as fit into one answer, in their order.
    pub fn meshes(&self, keys: &[u64]) -> Vec<u8> {
        let mut to = Writer::default();
        for key in keys {
            let Some(mesh) = self.by_key.get(key) else {
                continue;
            };
            if !to.0.is_empty() && to.0.len() >= ANSWER_BYTES {
                break;
            }
            to.put(*key);
            put_mesh(mesh, &mut to);
        }
        to.0
    }

    fn give_keys(&mut self) {
        if std::mem::replace(&mut self.keyed, self.version) == self.version {
            return;
        }
        // Those that nobody else holds will not be shown again.
        self.by_key.clear();
        self.keys.retain(|_, (_, mesh)| Arc::strong_count(mesh) > 1);
        for mesh in self.assets.iter().flat_map(|assets| &assets.meshes) {
            let next_key = &mut self.next_key;
            self.keys.entry(place(mesh)).or_insert_with(|| {
                *next_key += 1;
                (*next_key, mesh.clone())
            });
        }
        let meshes = self.keys.values();
        self.by_key = meshes.map(|(key, mesh)| (*key, mesh.clone())).collect();
    }
}

fn place(mesh: &Arc<Mesh>) -> usize {
    Arc::as_ptr(mesh) as usize
}

/// A copy of the scenery.
#[derive(Default)]
pub struct SceneryCopy {
    /// The version that is complete; 0 before the first.
    version: u64,
    assets: Arc<SceneAssets>,
    meshes: BTreeMap<u64, Arc<Mesh>>,
}

/// A list whose meshes are being asked for.
pub struct SceneryList {
    version: u64,
    keys: Vec<u64>,
    assets: SceneAssets,
    meshes: BTreeMap<u64, Arc<Mesh>>,
}

impl SceneryCopy {
    /// The version that is complete; 0 before the first.
    pub fn version(&self) -> u64 {
        self.version
    }

    /// What is there.
    pub fn assets(&self) -> &Arc<SceneAssets> {
        &self.assets
    }

    /// Begins to take a version over from its list.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn begin(&self, list: &[u8]) -> anyhow::Result<SceneryList> {
        let list = read_list(list).context("the scenery's list cannot be read")?;
        let known = list
            .keys
            .iter()
            .filter_map(|key| Some((*key, self.meshes.get(key)?.clone())));
        Ok(SceneryList {
            meshes: known.collect(),
            ..list
        })
    }

    /// Takes a version over that is complete. Returns whether other objects are shown, and not only
    /// other lamps.
    pub fn finish(&mut self, list: SceneryList) -> bool {
        let SceneryList {
            version,
            keys,
            mut assets,
            meshes,
        } = list;
        assets.meshes = keys.iter().map(|key| meshes[key].clone()).collect();
        let known = &self.assets;
        let is_same = |(a, b): (&StaticInstance, &StaticInstance)| {
            (a.mesh, a.object, a.world_from_mesh) == (b.mesh, b.object, b.world_from_mesh)
        };
        let shows_the_same = self.version != 0
            && known.episode == assets.episode
            && known.meshes.len() == assets.meshes.len()
            && known.statics.len() == assets.statics.len()
            && known
                .meshes
                .iter()
                .zip(&assets.meshes)
                .all(|(a, b)| Arc::ptr_eq(a, b))
            && known.statics.iter().zip(&assets.statics).all(is_same);
        self.version = version;
        self.assets = Arc::new(assets);
        self.meshes = meshes;
        !shows_the_same
    }
}

impl SceneryList {
    /// Keys of the meshes that are missing.
    pub fn missing(&self) -> Vec<u64> {
        let wanted: BTreeSet<u64> = self.keys.iter().copied().collect();
        let is_missing = |key: &u64| !self.meshes.contains_key(key);
        wanted.into_iter().filter(is_missing).collect()
    }

    /// Adds meshes; returns how many.
    ///
    /// # Errors
    /// If they cannot be read.
    pub fn add(&mut self, answer: &[u8]) -> anyhow::Result<usize> {
        let mut from = Reader(answer);
        let mut n = 0;
        while !from.0.is_empty() {
            let key = from.get()?;
            let mesh = get_mesh(&mut from).context("a mesh cannot be read")?;
            self.meshes.insert(key, Arc::new(mesh));
            n += 1;
        }
        Ok(n)
    }
}

fn read_list(list: &[u8]) -> anyhow::Result<SceneryList> {
    let mut from = Reader(list);
    let version = from.get()?;
    let mut assets = SceneAssets {
        episode: from.get()?,
        streamed: from.get::<u8>()? != 0,
        ..SceneAssets::default()
    };
    let keys: Vec<u64> = from.get_all()?;
    for _ in 0..from.get_len()? {
        let (mesh, world_from_mesh, object) = (from.get()?, from.get::<Pose>()?, from.get()?);
        ensure!((mesh as usize) < keys.len(), "there is no mesh {mesh}");
        assets.statics.push(StaticInstance {
            mesh: MeshId(mesh),
            world_from_mesh: world_from_mesh.isometry(),
            object: ObjectId(object),
        });
    }
    for _ in 0..from.get_len()? {
        let object = ObjectId(from.get()?);
        let on = match from.get::<u8>()? {
            2 => None,
            other => Some(other != 0),
        };
        let (has_colour, rgb) = (from.get::<u8>()? != 0, from.get()?);
        let setting = LampSetting {
            on,
            rgb: has_colour.then_some(rgb),
            strength_ratio: from.get()?,
        };
        assets.switched.insert(object, setting);
    }
    assets.hidden = from.get_all()?.into_iter().map(ObjectId).collect();
    from.end()?;
    Ok(SceneryList {
        version,
        keys,
        assets,
        meshes: BTreeMap::new(),
    })
}

fn put_mesh(mesh: &Mesh, to: &mut Writer) {
    to.put_text(&mesh.name);
    to.put_all(&mesh.vertices);
    to.put_all(&mesh.indices);
    to.put_len(mesh.lods.len());
    for lod in &mesh.lods {
        to.put([lod.first_idx, lod.n_indices]);
        to.put(lod.until_m);
    }
    to.put(mesh.centre_m);
    to.put(mesh.radius_m);
}

fn get_mesh(from: &mut Reader<'_>) -> anyhow::Result<Mesh> {
    let name = from.get_text()?;
    let vertices: Vec<Vertex> = from.get_all()?;
    let indices: Vec<u32> = from.get_all()?;
    ensure!(
        indices.iter().all(|idx| (*idx as usize) < vertices.len()),
        "a triangle of {name:?} has a corner that is not there"
    );
    let mut lods = Vec::new();
    for _ in 0..from.get_len()? {
        let [first_idx, n_indices] = from.get::<[u32; 2]>()?;
        let end = u64::from(first_idx) + u64::from(n_indices);
        ensure!(
            end <= indices.len() as u64,
            "a level of {name:?} has triangles that are not there"
        );
        lods.push(Lod {
            first_idx,
            n_indices,
            until_m: from.get()?,
        });
    }
    Ok(Mesh {
        name,
        vertices,
        indices,
        lods,
        centre_m: from.get()?,
        radius_m: from.get()?,
    })
}

#[cfg(test)]
mod tests {
    use nalgebra::Isometry3;
    use schema_types::Class;
    use sensor_core::mesh::{Material, MeshBuilder, Surface};

    use super::*;

    fn post(size_m: f32) -> Mesh {
        let mut builder = MeshBuilder::new("post");
        let surface = Surface::new(Class::POLES, Material::Metal, [90; 3]);
        builder.cuboid(surface, [0.0; 3], [size_m; 3]);
        builder.finish()
    }

    /// Takes the newest version over, two meshes an answer; returns how many meshes came.
    fn follow(copy: &mut SceneryCopy, source: &mut Scenery) -> (usize, bool) {
        let mut list = copy.begin(&source.list()).unwrap();
        let mut n_came = 0;
        loop {
            let missing = list.missing();
            if missing.is_empty() {
                break;
            }
            n_came += list
                .add(&source.meshes(&missing[..missing.len().min(2)]))
                .unwrap();
        }
        (n_came, copy.finish(list))
    }

    #[test]
    fn only_what_is_not_known_yet_travels() {
        let mut assets = SceneAssets {
            episode: 2,
            streamed: true,
            ..SceneAssets::default()
        };
        for n in 0..5 {
            let mesh = assets.add_mesh(post(1.0 + n as f32));
            assets.statics.push(StaticInstance {
                mesh,
                world_from_mesh: Isometry3::translation(0.1 * n as f64, 0.0, 0.0),
                object: ObjectId(1 << 31 | n),
            });
        }
        let (mut source, mut copy) = (Scenery::default(), SceneryCopy::default());
        let whole = Arc::new(assets.clone());
        assert_eq!(source.version_of(&whole), 1);
        assert_eq!(source.version_of(&whole), 1);
        assert_eq!(follow(&mut copy, &mut source), (5, true));
        assert_eq!(copy.version(), 1);
        assert_eq!(format!("{:?}", copy.assets()), format!("{whole:?}"));

        // Lamps alone.
        let lamp = LampSetting {
            on: None,
            rgb: Some([1, 2, 3]),
            strength_ratio: 0.3,
        };
        assets.switched.insert(ObjectId(1 << 31), lamp);
        let switched = Arc::new(assets.clone());
        assert_eq!(source.version_of(&switched), 2);
        assert_eq!(follow(&mut copy, &mut source), (0, false));
        assert_eq!(format!("{:?}", copy.assets()), format!("{switched:?}"));

        // Something hidden: what stays is the same mesh in memory.
        let before = copy.assets().clone();
        let less = Arc::new(assets.without(&BTreeSet::from([ObjectId(1 << 31 | 3)])));
        assert_eq!(source.version_of(&less), 3);
        let (n_came, is_other) = follow(&mut copy, &mut source);
        assert!(n_came <= 1 && is_other);
        assert!(Arc::ptr_eq(&before.meshes[0], &copy.assets().meshes[0]));
        assert_eq!(format!("{:?}", copy.assets()), format!("{less:?}"));

        let list = source.list();
        for n_bytes in 0..list.len() {
            assert!(copy.begin(&list[..n_bytes]).is_err());
        }
        // Bytes that were changed are refused or read, whatever they say.
        let meshes = source.meshes(&copy.begin(&list).unwrap().keys);
        let mut state = 1;
        for _ in 0..2000 {
            state = schema_types::noise::mix(state);
            let change = |bytes: &[u8]| {
                let mut changed = bytes.to_vec();
                let at = state as usize % bytes.len();
                changed[at] ^= 1 << (state >> 32 & 7);
                changed
            };
            let _ = copy.begin(&change(&list));
            let _ = copy.begin(&list).unwrap().add(&change(&meshes));
        }
    }
}
