//! What Rust and the lidar shader must agree on: sizes, limits, and the parameters of a dispatch.

/// Rays whose returns are counted together, as in the shader.
pub(super) const CHUNK_RAYS: u32 = 256;
/// Entries of the shader's stack: one for each level of the deepest mesh and two for each level of
/// the hierarchy over instances.
pub(super) const STACK_ENTRIES: u32 = 32;
/// Rays of a workgroup.
pub(super) const BLOCK_RAYS: u32 = 64;

/// Places that the points of one dispatch may go to, as in the shader.
pub(super) const MAX_OUTPUTS: usize = 8;

/// Buffers of the scene and of scratch memory, as in the shader.
pub(super) const SCENE_BUFFERS: u32 = 7;
/// The buffer of totals and the outputs.
pub(super) const OUTPUT_BUFFERS: u32 = 1 + MAX_OUTPUTS as u32;
/// Lanes of a workgroup, as in the shader.
pub(super) const LANES: u32 = 64;
/// Memory of a workgroup, as in the shader: a number per lane, a ray per return of a chunk.
pub(super) const WORKGROUP_BYTES: u32 = 4 * (LANES + CHUNK_RAYS);

/// Parameters of a dispatch, as the shader reads them.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
pub(super) struct Dispatch {
    pub first_traced: u32,
    pub n_traced: u32,
    pub first_packed: u32,
    pub n_packed: u32,
    /// Largest number of blocks of rays that a traced lidar has.
    pub n_blocks: u32,
    /// Largest number of chunks that a packed lidar has.
    pub n_chunks: u32,
}

/// In a dispatch that does both, workgroups that trace for each one that packs.
pub(super) const TRACING: u32 = 4;
/// Most workgroups along one side of a dispatch.
pub(super) const MAX_SIDE: u32 = 65_535;

impl Dispatch {
    /// Whether the workgroups of a dispatch that only traces or only packs fit into two dimensions.
    pub fn fits(&self) -> bool {
        [self.n_blocks, self.n_traced, self.n_chunks, self.n_packed]
            .into_iter()
            .all(|side| side <= MAX_SIDE)
    }

    /// Number of workgroups in x, y and z, as the shader expects them.
    pub fn size(&self) -> [u32; 3] {
        match (self.n_traced, self.n_packed) {
            (n_traced, 0) if self.fits() => [self.n_blocks, n_traced, 1],
            (0, n_packed) if self.fits() => [self.n_chunks, n_packed, 1],
            (n_traced, n_packed) => {
                let places =
                    (n_packed * self.n_chunks).max((n_traced * self.n_blocks).div_ceil(TRACING));
                [1 + TRACING, places.min(MAX_SIDE), places.div_ceil(MAX_SIDE)]
            }
        }
    }
}
