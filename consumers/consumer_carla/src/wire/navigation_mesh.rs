//! The navigation mesh that clients load for their own crowds: a walkable mesh in the byte layout
//! of Detour 1.5's tile sets.
//!
//! Everything is little-endian and packed. The head holds the magic `MSET`, version 1, the number
//! of tiles and the set's parameters (origin, width and depth of a tile, most tiles, most
//! polygons). Each tile holds its reference (32 bits), its number of bytes, a header (100 bytes),
//! vertices (3 × f32), polygons (32 bytes), links (12 bytes, zero: the reader makes them), one
//! detail record (12 bytes) per polygon, detail triangles (4 bytes) and a bounding-volume tree (16
//! bytes per node).
//!
//! Detour's axes are x, z and −y of Gantry, which are CARLA's x, z, y; polygons that run
//! counter-clockwise in Gantry's axes have the winding that Detour wants. One tile holds
//! everything, so polygons are numbered with 15 bits.

use schema_roads::walkable::{Ground, WalkMesh};

/// "MSET" with M in the highest byte.
const SET_MAGIC: i32 = i32::from_be_bytes(*b"MSET");
const SET_VERSION: i32 = 1;
/// "DNAV" with D in the highest byte.
const TILE_MAGIC: i32 = i32::from_be_bytes(*b"DNAV");
const TILE_VERSION: i32 = 7;
/// Bytes of a tile's header, a polygon, a link, a detail record, a node.
const HEADER_BYTES: usize = 100;
#[cfg(test)]
const POLY_BYTES: usize = 32;
const LINK_BYTES: usize = 12;
#[cfg(test)]
const DETAIL_BYTES: usize = 12;
#[cfg(test)]
const NODE_BYTES: usize = 16;
/// Corners that a polygon has room for.
const POLY_CORNERS: usize = 6;
/// Bits of a reference: 20 for the polygon, 1 for the tile (of at most 2), 11 of salt.
const POLY_BITS: u32 = 20;
const TILE_BITS: u32 = 1;
/// Most polygons of one tile, and most vertices.
pub const MAX_POLYGONS: usize = 0x7ffe;
/// See [`MAX_POLYGONS`].
pub const MAX_VERTICES: usize = 0xfffe;
/// Quantisation steps of the tree's boxes per metre.
const STEPS_PER_M: f32 = 4.0;
/// Height, radius and step height of the walkers that the mesh is made for, metres.
const WALKER_M: [f32; 3] = [1.8, 0.3, 0.3];

/// Area number and flags of a kind of ground, as CARLA's client filters them.
fn area(ground: Ground) -> (u8, u16) {
    match ground {
        Ground::Sidewalk => (1, 0x02),
        Ground::Crosswalk => (2, 0x04),
        Ground::Road => (3, 0x08),
    }
}

/// A point in Detour's axes.
fn detour([x, y, z]: [f64; 3]) -> [f32; 3] {
    [x as f32, z as f32, -y as f32]
}

/// Bytes that are written in order.
#[derive(Default)]
struct Bytes(Vec<u8>);

impl Bytes {
    fn i32(&mut self, value: i32) {
        self.0.extend(value.to_le_bytes());
    }

    fn u32(&mut self, value: u32) {
        self.0.extend(value.to_le_bytes());
    }

    fn u16(&mut self, value: u16) {
        self.0.extend(value.to_le_bytes());
    }

    fn f32s(&mut self, values: impl IntoIterator<Item = f32>) {
        values
            .into_iter()
            .for_each(|value| self.0.extend(value.to_le_bytes()));
    }
}

/// The file; `None` for an empty mesh and for one that is too large for a tile.
pub fn file(mesh: &WalkMesh) -> Option<Vec<u8>> {
    if mesh.faces.is_empty()
        || mesh.faces.len() > MAX_POLYGONS
        || mesh.vertices_m.len() > MAX_VERTICES
    {
        return None;
    }
    let (low, high) = bounds(mesh.vertices_m.iter().map(|vertex| detour(*vertex)));
    let tile = tile(mesh, low, high);
    let mut out = Bytes::default();
    out.i32(SET_MAGIC);
    out.i32(SET_VERSION);
    out.i32(1);
    out.f32s(low);
    out.f32s([(high[0] - low[0]).max(1.0), (high[2] - low[2]).max(1.0)]);
    out.i32(1 << TILE_BITS);
    out.i32(1 << POLY_BITS);
    // Tile 0 with salt 1.
    out.u32(1 << (POLY_BITS + TILE_BITS));
    out.i32(tile.len() as i32);
    out.0.extend(tile);
    Some(out.0)
}

fn bounds(points: impl Iterator<Item = [f32; 3]>) -> ([f32; 3], [f32; 3]) {
    points.fold(([f32::MAX; 3], [f32::MIN; 3]), |(low, high), p| {
        (
            std::array::from_fn(|i| low[i].min(p[i])),
            std::array::from_fn(|i| high[i].max(p[i])),
        )
    })
}

fn tile(mesh: &WalkMesh, low: [f32; 3], high: [f32; 3]) -> Vec<u8> {
    let n_edges: usize = mesh.faces.iter().map(|face| face.corners.len()).sum();
    let n_triangles: usize = n_edges - 2 * mesh.faces.len();
    let nodes = tree(mesh, low);
    let mut out = Bytes::default();
    out.i32(TILE_MAGIC);
    out.i32(TILE_VERSION);
    [0, 0, 0, 0].into_iter().for_each(|place| out.i32(place));
    let counts = [
        mesh.faces.len(),
        mesh.vertices_m.len(),
        n_edges,
        mesh.faces.len(),
        0,
        n_triangles,
        nodes.len(),
        0,
        mesh.faces.len(),
    ];
    counts.into_iter().for_each(|count| out.i32(count as i32));
    out.f32s(WALKER_M);
    out.f32s(low);
    out.f32s(high);
    out.f32s([STEPS_PER_M]);
    debug_assert_eq!(out.0.len(), HEADER_BYTES);
    out.f32s(mesh.vertices_m.iter().flat_map(|vertex| detour(*vertex)));
    for face in &mesh.faces {
        polygon(&mut out, face);
    }
    out.0.resize(out.0.len() + n_edges * LINK_BYTES, 0);
    let mut first_triangle = 0;
    for face in &mesh.faces {
        let n = face.corners.len() - 2;
        out.u32(0);
        out.u32(first_triangle);
        out.0.extend([0, n as u8, 0, 0]);
        first_triangle += n as u32;
    }
    for face in &mesh.faces {
        let n = face.corners.len();
        for j in 2..n {
            // Two bits per edge: whether it lies on the polygon's outline.
            let outer = 1 << 2 | u8::from(j == 2) | u8::from(j == n - 1) << 4;
            out.0.extend([0, (j - 1) as u8, j as u8, outer]);
        }
    }
    for node in nodes {
        node.low
            .into_iter()
            .chain(node.high)
            .for_each(|x| out.u16(x));
        out.i32(node.escape_or_face);
    }
    out.0
}

fn polygon(out: &mut Bytes, face: &schema_roads::walkable::WalkFace) {
    let (area, flags) = area(face.ground);
    out.u32(u32::MAX);
    let corners = face.corners.iter().map(|corner| *corner as u16);
    // Neighbours count from 1; 0 is a wall.
    let neighbours = face
        .neighbours
        .iter()
        .map(|other| other.map_or(0, |other| other as u16 + 1));
    corners
        .chain(std::iter::repeat(0))
        .take(POLY_CORNERS)
        .for_each(|x| out.u16(x));
    neighbours
        .chain(std::iter::repeat(0))
        .take(POLY_CORNERS)
        .for_each(|x| out.u16(x));
    out.u16(flags);
    out.0.extend([face.corners.len() as u8, area]);
}

/// A node of the tree: a quantised box, and either the face (a leaf) or, as a negative number, the
/// number of nodes to skip its subtree.
#[derive(Clone, Copy, Debug)]
struct Node {
    low: [u16; 3],
    high: [u16; 3],
    escape_or_face: i32,
}

fn tree(mesh: &WalkMesh, origin: [f32; 3]) -> Vec<Node> {
    let step = |x: f32, origin: f32| (x - origin) * STEPS_PER_M;
    let leaf = |face: usize| {
        let (low, high) = bounds(mesh.corners_m(face).map(detour));
        Node {
            low: std::array::from_fn(|i| {
                step(low[i], origin[i]).floor().clamp(0.0, 65535.0) as u16
            }),
            high: std::array::from_fn(|i| {
                step(high[i], origin[i]).ceil().clamp(0.0, 65535.0) as u16
            }),
            escape_or_face: face as i32,
        }
    };
    let mut leaves: Vec<Node> = (0..mesh.faces.len()).map(leaf).collect();
    let mut nodes = Vec::with_capacity(2 * leaves.len());
    split(&mut leaves, &mut nodes);
    nodes
}

fn split(leaves: &mut [Node], nodes: &mut Vec<Node>) {
    if let [leaf] = leaves {
        nodes.push(*leaf);
        return;
    }
    let first = nodes.len();
    let low: [u16; 3] =
        std::array::from_fn(|i| leaves.iter().map(|leaf| leaf.low[i]).min().unwrap_or(0));
    let high: [u16; 3] =
        std::array::from_fn(|i| leaves.iter().map(|leaf| leaf.high[i]).max().unwrap_or(0));
    nodes.push(Node {
        low,
        high,
        escape_or_face: 0,
    });
    let axis = if high[0] - low[0] >= high[2] - low[2] {
        0
    } else {
        2
    };
    leaves.sort_by_key(|leaf| (leaf.low[axis], leaf.escape_or_face));
    let (left, right) = leaves.split_at_mut(leaves.len() / 2);
    split(left, nodes);
    split(right, nodes);
    nodes[first].escape_or_face = -((nodes.len() - first) as i32);
}

/// A hash of the file's bytes, which goes into its name: clients keep files by name for ever.
pub fn hash(bytes: &[u8]) -> u64 {
    let mut state = 0xcbf2_9ce4_8422_2325u64;
    for byte in bytes {
        state = (state ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
    }
    state
}

#[cfg(test)]
mod tests {
    use super::*;
    use schema_roads::walkable::WalkFace;

    /// Two squares side by side: a pavement and a crosswalk.
    fn two_squares() -> WalkMesh {
        let vertices_m = vec![
            [0.0, 0.0, 1.0],
            [2.0, 0.0, 1.0],
            [2.0, 2.0, 1.0],
            [0.0, 2.0, 1.0],
            [4.0, 0.0, 1.0],
            [4.0, 2.0, 1.0],
        ];
        let first = WalkFace {
            corners: vec![0, 1, 2, 3],
            neighbours: vec![None, Some(1), None, None],
            ground: Ground::Sidewalk,
        };
        let second = WalkFace {
            corners: vec![1, 4, 5, 2],
            neighbours: vec![None, None, None, Some(0)],
            ground: Ground::Crosswalk,
        };
        WalkMesh {
            vertices_m,
            faces: vec![first, second],
        }
    }

    #[test]
    fn bytes_lie_where_detour_reads_them() {
        let bytes = file(&two_squares()).unwrap();
        assert_eq!(&bytes[..4], b"TESM");
        let i32_at = |at: usize| i32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
        let f32_at = |at: usize| f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
        let u16_at = |at: usize| u16::from_le_bytes(bytes[at..at + 2].try_into().unwrap());
        assert_eq!((i32_at(4), i32_at(8)), (1, 1));
        assert_eq!((f32_at(12), f32_at(16), f32_at(20)), (0.0, 1.0, -2.0));
        let tile = 48;
        assert_eq!(i32_at(44) as usize, bytes.len() - tile);
        assert_eq!(&bytes[tile..tile + 4], b"VAND");
        assert_eq!(
            (i32_at(tile + 4), i32_at(tile + 24), i32_at(tile + 28)),
            (7, 2, 6)
        );
        let vertices = tile + HEADER_BYTES;
        assert_eq!(
            (
                f32_at(vertices + 60),
                f32_at(vertices + 64),
                f32_at(vertices + 68)
            ),
            (4.0, 1.0, -2.0)
        );
        let polygons = vertices + 6 * 12;
        assert_eq!(
            (
                u16_at(polygons + 4),
                u16_at(polygons + 6),
                u16_at(polygons + 18)
            ),
            (0, 1, 2)
        );
        assert_eq!(
            (
                u16_at(polygons + 28),
                bytes[polygons + 30],
                bytes[polygons + 31]
            ),
            (0x02, 4, 1)
        );
        assert_eq!(
            (
                u16_at(polygons + POLY_BYTES + 28),
                bytes[polygons + POLY_BYTES + 31]
            ),
            (0x04, 2)
        );
        let nodes = polygons + 2 * POLY_BYTES + 8 * LINK_BYTES + 2 * DETAIL_BYTES + 4 * 4;
        assert_eq!(bytes.len(), nodes + 3 * NODE_BYTES);
        assert_eq!(
            (i32_at(nodes + 12), i32_at(nodes + 28), i32_at(nodes + 44)),
            (-3, 0, 1)
        );
    }

    #[test]
    fn a_mesh_that_does_not_fit_is_no_file() {
        assert_eq!(file(&WalkMesh::default()), None);
        let many = WalkMesh {
            faces: vec![two_squares().faces[0].clone(); MAX_POLYGONS + 1],
            ..two_squares()
        };
        assert_eq!(file(&many), None);
    }
}
