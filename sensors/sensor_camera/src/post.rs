//! Post-processing of colour: exposure, lens, bloom, white balance, film, smooth edges.
//!
//! Compute shaders work on the shaded radiance. Views with neutral optics and without edge
//! smoothing skip them.

use std::collections::BTreeMap;

use bytemuck::{Pod, Zeroable};
use sensor_gpu::{Gpu, Uploads};
use sensor_spec::{ExposureMode, FilmCurve, Intrinsics, OpticsSpec};

use crate::binding_layout::{
    entry, grow, texture, texture_of, uniform_at_offset, written_layers, written_storage,
};
use crate::bindings::Together;
use crate::blur::{BlurJob, BlurPass};
use crate::target::{Image, Target, TargetSet, Targets, image};
use crate::uniform::MAX_TOGETHER;

/// Text of the shader.
pub(crate) fn post_wgsl() -> String {
    [
        include_str!("shader/film.wgsl"),
        include_str!("shader/post.wgsl"),
    ]
    .concat()
}

/// Mirror of `Post` in `shader/post.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct PostData {
    /// Width and height.
    pub size_px: [f32; 2],
    /// One over each.
    pub per_px: [f32; 2],
    /// Factor of the light.
    pub factor: f32,
    /// Whether the meter's exposure is applied.
    pub is_metered: f32,
    /// Exponent of the display's curve.
    pub gamma_exponent: f32,
    /// Whether there is film.
    pub has_film: f32,
    /// The meter never says less.
    pub min_ev100: f32,
    /// The meter never says more.
    pub max_ev100: f32,
    /// Share of the way to the light that the meter goes in this firing.
    pub up_share: f32,
    /// The same to the dark.
    pub down_share: f32,
    /// Luminance of white as shaded.
    pub white_cd_per_m2: f32,
    /// The meter's constant.
    pub calibration: f32,
    /// Whether edges are smoothed.
    pub smooths_edges: f32,
    /// Strength of bloom.
    pub bloom: f32,
    /// Distortion.
    pub distortion_k: f32,
    /// Its cubic part.
    pub distortion_k_cubed: f32,
    /// Its scale in x and y.
    pub distortion_size: [f32; 2],
    /// Darkening of the corners.
    pub vignette_multiplier: f32,
    /// Exponent of that.
    pub vignette_falloff: f32,
    /// Chromatic aberration.
    pub aberration: f32,
    /// Where it begins.
    pub aberration_start: f32,
    /// White balance: gains of red, green, blue.
    pub white_rgb: [f32; 3],
    /// Layer of the image.
    pub layer: u32,
    /// Width and height of the picture, which lies in the middle of the image.
    pub out_px: [f32; 2],
    /// Strength of ghosts.
    pub flare: f32,
    /// Whether the film's curve is a shaped one.
    pub is_shaped: f32,
    /// Shaped film: steepness of its straight part.
    pub slope: f32,
    /// Where its toe ends, log10 of light.
    pub toe_at: f32,
    /// Where its shoulder begins.
    pub shoulder_at: f32,
    /// Offset of its straight part.
    pub straight_offset: f32,
    /// Height of its toe.
    pub toe_height: f32,
    /// Height of its shoulder.
    pub shoulder_height: f32,
    /// How far it reaches below black.
    pub black_clip: f32,
    /// How far it reaches above white.
    pub white_clip: f32,
    /// Unused: a uniform's offset can be a multiple of 256 only.
    pub rest: [[u32; 4]; 6],
}

/// One view's work.
pub(crate) struct PostJob<'p> {
    /// Number of its view in this submission.
    pub view_idx: usize,
    pub optics: &'p OpticsSpec,
    /// The picture's lens, without margins.
    pub lens: Intrinsics,
    pub targets: &'p Targets,
    /// Its layer in these targets.
    pub layer: u32,
    /// State of automatic exposure, if the mode has one.
    pub meter: Option<&'p wgpu::Buffer>,
    /// Kilolux to what was shaded: 1 is white.
    pub exposure: f32,
    /// Simulated time since the previous firing.
    pub since_secs: f32,
    pub smooth_edges: bool,
    /// Whether radiance without alpha is beyond a lens's field and stays black; `PostPass::new` is
    /// told the same.
    pub has_field: bool,
}

impl PostJob<'_> {
    fn has_bloom(&self) -> bool {
        self.optics.postprocess && self.optics.bloom_intensity > 0.0
    }

    fn has_flare(&self) -> bool {
        self.optics.postprocess && self.optics.flare_intensity > 0.0
    }

    /// Whether it needs no meter, glow, blur or longer program, so that it can be developed
    /// together with other plain views.
    pub fn is_plain(&self) -> bool {
        let only_smooths = Program {
            smooths_edges: false,
            ..self.program()
        };
        self.meter.is_none()
            && !self.has_bloom()
            && only_smooths == Program::default()
            && !self.optics.is_blurred()
    }

    fn program(&self) -> Program {
        Program {
            shaped_film: self.optics.film.curve == FilmCurve::Shaped,
            ghosts: self.has_flare(),
            lens: self.optics.distortion().is_some(),
            smooths_edges: self.smooth_edges,
            has_field: self.has_field,
        }
    }
}

/// What a development program can do. Software adapters spend time on whatever is in it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
struct Program {
    shaped_film: bool,
    ghosts: bool,
    lens: bool,
    smooths_edges: bool,
    has_field: bool,
}

/// What development reads of a view beside radiance.
pub(crate) fn reads(optics: &OpticsSpec) -> TargetSet {
    let mut set = TargetSet::default();
    if optics.is_blurred() {
        set = set.union(Target::Depth.bit());
    }
    if optics.smears_motion() {
        set = set.union(Target::Flow.bit());
    }
    set
}

/// Pixels of one workgroup, as `post.wgsl` has it.
const GROUP_PX: [u32; 2] = [16, 8];
/// How often the image is halved for bloom.
const N_GLOW: usize = 4;
/// Share of the light that strays, at intensity 1.
const BLOOM_SHARE: f32 = 0.06;
/// Share of light far above white that a ghost shows at intensity 1, in its brightest colour.
const FLARE_SHARE: f32 = 0.2;

/// Pipelines.
#[derive(Debug)]
pub(crate) struct PostPass {
    layout: wgpu::BindGroupLayout,
    pipeline_layout: wgpu::PipelineLayout,
    shader: wgpu::ShaderModule,
    /// For plain views.
    main: wgpu::ComputePipeline,
    /// For all others, by what they need; made when the first view needs it.
    programs: BTreeMap<Program, wgpu::ComputePipeline>,
    metering: wgpu::ComputePipeline,
    shrink: wgpu::ComputePipeline,
    shrink_bright: wgpu::ComputePipeline,
    /// Made for the first view that is blurred.
    blur: Option<BlurPass>,
    sampler: wgpu::Sampler,
    /// Bound where a pass writes no colour or reads no glow.
    no_color: Image,
    black: Image,
    /// Stand-ins for a view's meter and glow. Each view has its own, because shared ones would make
    /// the GPU serialise the views.
    spares: Vec<(wgpu::Buffer, Image)>,
    data: wgpu::Buffer,
}

/// A pipeline of `post.wgsl` that can do so much.
fn program(
    gpu: &Gpu,
    layout: &wgpu::PipelineLayout,
    shader: &wgpu::ShaderModule,
    entry_point: &str,
    can: Program,
) -> wgpu::ComputePipeline {
    let constants = [
        ("HAS_SHAPED_FILM", can.shaped_film),
        ("HAS_GHOSTS", can.ghosts),
        ("HAS_LENS", can.lens),
        ("SMOOTHS_EDGES", can.smooths_edges),
        ("HAS_FIELD", can.has_field),
    ]
    .map(|(name, is_on)| (name, f64::from(u8::from(is_on))));
    gpu.device()
        .create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(entry_point),
            layout: Some(layout),
            module: shader,
            entry_point: Some(entry_point),
            compilation_options: wgpu::PipelineCompilationOptions {
                constants: &constants,
                ..Default::default()
            },
            cache: None,
        })
}

/// Distance between two views' uniforms; Vulkan's largest required alignment is 256.
const POST_BYTES: u64 = size_of::<PostData>() as u64;
const _: () = assert!(POST_BYTES.is_multiple_of(256));
/// What one binding holds.
const POSTS_BYTES: u64 = POST_BYTES * MAX_TOGETHER as u64;

impl PostPass {
    /// The passes for pinhole images, or for those of lenses whose field may end before the image's
    /// rim.
    pub fn new(gpu: &Gpu, has_field: bool) -> Self {
        let device = gpu.device();
        let written = |binding, format| {
            let access = wgpu::StorageTextureAccess::WriteOnly;
            entry(
                binding,
                wgpu::BindingType::StorageTexture {
                    access,
                    format,
                    view_dimension: wgpu::TextureViewDimension::D2,
                },
            )
        };
        let mut entries = [
            uniform_at_offset(0, POSTS_BYTES),
            texture_of(
                1,
                wgpu::TextureSampleType::Float { filterable: true },
                wgpu::TextureViewDimension::D2Array,
            ),
            entry(
                2,
                wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering),
            ),
            written_storage(3),
            written_layers(4, Target::Color.format()),
            texture(5, wgpu::TextureSampleType::Float { filterable: true }),
            written(6, GLOW_FORMAT),
            texture(7, wgpu::TextureSampleType::Float { filterable: true }),
        ];
        entries
            .iter_mut()
            .for_each(|entry| entry.visibility = wgpu::ShaderStages::COMPUTE);
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("post"),
            entries: &entries,
        });
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("post"),
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        });
        let shader = gpu.shader("post", &post_wgsl());
        let plain = Program {
            smooths_edges: true,
            has_field,
            ..Program::default()
        };
        let pipeline = |entry_point| program(gpu, &pipeline_layout, &shader, entry_point, plain);
        PostPass {
            main: pipeline("cs_main"),
            programs: BTreeMap::new(),
            metering: pipeline("cs_meter"),
            shrink: pipeline("cs_shrink"),
            shrink_bright: pipeline("cs_shrink_bright"),
            blur: None,
            layout,
            pipeline_layout,
            shader,
            sampler: device.create_sampler(&wgpu::SamplerDescriptor {
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                ..Default::default()
            }),
            no_color: image(
                gpu,
                "nowhere",
                [1, 1],
                Target::Color.format(),
                wgpu::TextureUsages::STORAGE_BINDING,
            ),
            black: image(
                gpu,
                "no glow",
                [1, 1],
                GLOW_FORMAT,
                wgpu::TextureUsages::TEXTURE_BINDING,
            ),
            spares: Vec::new(),
            data: gpu.buffer(
                "post",
                POSTS_BYTES,
                wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            ),
        }
    }

    /// Uploads the settings of the developed views; the submission has `n_views` in all.
    pub fn upload(
        &mut self,
        gpu: &Gpu,
        (uploads, encoder): (&mut Uploads, &mut wgpu::CommandEncoder),
        jobs: &[&PostJob<'_>],
        n_views: usize,
    ) {
        if jobs.is_empty() {
            return;
        }
        if jobs.iter().any(|job| job.optics.is_blurred()) {
            self.blur.get_or_insert_with(|| BlurPass::new(gpu));
        }
        for job in jobs.iter().filter(|job| !job.is_plain()) {
            let can = job.program();
            self.programs.entry(can).or_insert_with(|| {
                program(gpu, &self.pipeline_layout, &self.shader, "cs_main", can)
            });
        }
        while self.spares.len() < n_views {
            self.spares.push((
                meter(gpu),
                image(
                    gpu,
                    "nowhere",
                    [1, 1],
                    GLOW_FORMAT,
                    wgpu::TextureUsages::STORAGE_BINDING,
                ),
            ));
        }
        let mut data = vec![PostData::zeroed(); n_views];
        for job in jobs {
            data[job.view_idx] = post_data(job, job.targets.size_px(Target::Radiance.bit()));
        }
        // The binding of the last view extends beyond its uniform.
        grow(
            gpu,
            &mut self.data,
            POST_BYTES * n_views as u64 + POSTS_BYTES,
        );
        uploads.write(encoder, &self.data, 0, bytemuck::cast_slice(&data));
    }

    /// Records the development from `Radiance` to `Color` of plain views whose targets are layers
    /// of the same textures.
    pub fn develop_plain(&self, gpu: &Gpu, pass: &mut wgpu::ComputePass<'_>, views: &Together<'_>) {
        let radiance = views.targets.get(Target::Radiance);
        let color = &views.targets.get(Target::Color).layers;
        let (no_meter, no_glow) = &self.spares[views.first];
        let images = [color, &self.black.view, &self.black.view, &no_glow.view];
        let entries = self.entries(&radiance.layers, no_meter, images);
        let kept = &views.targets.groups;
        let bound = kept.bind(gpu, "post", &self.layout, &entries);
        let [across, down] = groups([radiance.texture.width(), radiance.texture.height()]);
        pass.set_pipeline(&self.main);
        pass.set_bind_group(0, &bound, &[offset_of(views.first)]);
        pass.dispatch_workgroups(across, down, views.n as u32);
    }

    /// Records the same for one view with a meter, bloom, flare or blur.
    pub fn develop(&self, gpu: &Gpu, pass: &mut wgpu::ComputePass<'_>, job: &PostJob<'_>) {
        let radiance = job.targets.get(Target::Radiance);
        let size_px = [radiance.texture.width(), radiance.texture.height()];
        let [radiance, color] =
            [radiance, job.targets.get(Target::Color)].map(|image| image.single_layer(job.layer));
        let (no_meter, no_glow) = &self.spares[job.view_idx];
        let meter = job.meter.unwrap_or(no_meter);
        let (no_color, no_glow, black) = (&self.no_color.layers, &no_glow.view, &self.black.view);
        let blurred = self.blur.as_ref().and_then(|blur| {
            let job = BlurJob {
                optics: job.optics,
                lens: job.lens,
                targets: job.targets,
                layer: job.layer,
                since_secs: job.since_secs,
            };
            blur.record(gpu, pass, &job)
        });
        let source = blurred.as_ref().map_or(&radiance, |image| &image.layers);
        let mut run = |pipeline: &wgpu::ComputePipeline,
                       from: &wgpu::TextureView,
                       images: [&wgpu::TextureView; 4],
                       groups: [u32; 2]| {
            pass.set_pipeline(pipeline);
            pass.set_bind_group(
                0,
                &self.bind(gpu, from, meter, images),
                &[offset_of(job.view_idx)],
            );
            pass.dispatch_workgroups(groups[0], groups[1], 1);
        };
        if job.meter.is_some() {
            run(
                &self.metering,
                &radiance,
                [no_color, black, black, no_glow],
                [1, 1],
            );
        }
        // Halves the image several times; the first step differs.
        let mut shrunk = |first: &wgpu::ComputePipeline| {
            let (mut size, mut last) = (size_px, None::<Image>);
            for i in 0..N_GLOW {
                size = size.map(|side| side.div_ceil(2));
                let usage =
                    wgpu::TextureUsages::STORAGE_BINDING | wgpu::TextureUsages::TEXTURE_BINDING;
                let smaller = image(gpu, "glow", size, GLOW_FORMAT, usage);
                let from = last.as_ref().map_or(source, |glow| &glow.layers);
                let pipeline = if i == 0 { first } else { &self.shrink };
                let images = [no_color, black, black, &smaller.view];
                run(pipeline, from, images, groups(size));
                last = Some(smaller);
            }
            last
        };
        let glow = match job.has_bloom() {
            true => shrunk(&self.shrink),
            false => None,
        };
        let ghosts = match job.has_flare() {
            true => shrunk(&self.shrink_bright),
            false => None,
        };
        let [glow, ghosts] =
            [&glow, &ghosts].map(|image| image.as_ref().map_or(black, |image| &image.view));
        let images = [&color, glow, ghosts, no_glow];
        let main = self.programs.get(&job.program());
        let main = main.expect("a view's program is made when its settings are uploaded");
        run(main, source, images, groups(size_px));
    }

    /// Bind group of the source, the meter, and the images for colour, glow, ghosts, and glow output.
    fn bind(
        &self,
        gpu: &Gpu,
        from: &wgpu::TextureView,
        meter: &wgpu::Buffer,
        images: [&wgpu::TextureView; 4],
    ) -> wgpu::BindGroup {
        gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("post"),
            layout: &self.layout,
            entries: &self.entries(from, meter, images),
        })
    }

    fn entries<'e>(
        &'e self,
        from: &'e wgpu::TextureView,
        meter: &'e wgpu::Buffer,
        [color, glow, ghosts, glow_out]: [&'e wgpu::TextureView; 4],
    ) -> [wgpu::BindGroupEntry<'e>; 8] {
        let view = |binding, view| wgpu::BindGroupEntry {
            binding,
            resource: wgpu::BindingResource::TextureView(view),
        };
        let data = wgpu::BufferBinding {
            buffer: &self.data,
            offset: 0,
            size: std::num::NonZeroU64::new(POSTS_BYTES),
        };
        [
            wgpu::BindGroupEntry {
                binding: 0,
                resource: wgpu::BindingResource::Buffer(data),
            },
            view(1, from),
            wgpu::BindGroupEntry {
                binding: 2,
                resource: wgpu::BindingResource::Sampler(&self.sampler),
            },
            buffer_entry(3, meter),
            view(4, color),
            view(5, glow),
            view(6, glow_out),
            view(7, ghosts),
        ]
    }
}

/// Workgroups for an image of this size.
fn groups(size: [u32; 2]) -> [u32; 2] {
    [size[0].div_ceil(GROUP_PX[0]), size[1].div_ceil(GROUP_PX[1])]
}

/// Where a view's uniform begins.
fn offset_of(view_idx: usize) -> u32 {
    (view_idx as u64 * POST_BYTES) as u32
}

const GLOW_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;

fn buffer_entry(binding: u32, buffer: &wgpu::Buffer) -> wgpu::BindGroupEntry<'_> {
    wgpu::BindGroupEntry {
        binding,
        resource: buffer.as_entire_binding(),
    }
}

/// State of automatic exposure before the first frame.
pub(crate) fn meter(gpu: &Gpu) -> wgpu::Buffer {
    gpu.buffer_with("meter", &[0; 16], wgpu::BufferUsages::STORAGE)
}

fn post_data(job: &PostJob<'_>, size_px: [u32; 2]) -> PostData {
    let optics = job.optics;
    let exposure = &optics.exposure;
    let [width, height] = size_px.map(|side| side as f32);
    // Candela per square metre of a shaded value of 1; the model's unit is kilolux per steradian.
    let white = 1000.0 / job.exposure;
    let gain = exposure.compensation_ev.exp2();
    let (factor, metered) = match exposure.mode {
        ExposureMode::Histogram if optics.postprocess => (gain, 1.0),
        ExposureMode::Manual => (gain * white / (1.2 * exposure.manual_ev100().exp2()), 0.0),
        ExposureMode::Weather | ExposureMode::Histogram => (gain, 0.0),
    };
    // A difference decays exponentially over time.
    let gone = |per_s: f32| 1.0 - (-per_s * job.since_secs).exp();
    let number = |on: bool| on as u32 as f32;
    let film = optics.film.parts();
    PostData {
        size_px: [width, height],
        per_px: [1.0 / width, 1.0 / height],
        factor,
        is_metered: metered,
        gamma_exponent: 2.2 / optics.gamma,
        has_film: number(optics.postprocess),
        min_ev100: exposure.min_ev100,
        max_ev100: exposure.max_ev100,
        up_share: gone(exposure.speed_up_per_s),
        down_share: gone(exposure.speed_down_per_s),
        white_cd_per_m2: white,
        calibration: exposure.calibration,
        smooths_edges: number(job.smooth_edges),
        bloom: if optics.postprocess {
            optics.bloom_intensity * BLOOM_SHARE
        } else {
            0.0
        },
        distortion_k: optics.distortion_k,
        distortion_k_cubed: optics.distortion_k_cubed,
        distortion_size: optics.distortion_size,
        vignette_multiplier: optics.vignette_multiplier,
        vignette_falloff: optics.vignette_falloff,
        aberration: optics.chromatic_aberration,
        aberration_start: optics.chromatic_aberration_start,
        white_rgb: white_gains(optics.white_kelvin, optics.tint),
        // Other views are bound with a single layer.
        layer: if job.is_plain() { job.layer } else { 0 },
        out_px: [job.lens.width_px as f32, job.lens.height_px as f32],
        flare: if job.has_flare() {
            optics.flare_intensity * FLARE_SHARE
        } else {
            0.0
        },
        is_shaped: number(optics.film.curve == FilmCurve::Shaped),
        slope: optics.film.slope,
        toe_at: film.toe_at,
        shoulder_at: film.shoulder_at,
        straight_offset: film.straight_offset,
        toe_height: film.toe_height,
        shoulder_height: film.shoulder_height,
        black_clip: optics.film.black_clip,
        white_clip: optics.film.white_clip,
        rest: [[0; 4]; 6],
    }
}

/// Gains that make light of this temperature white; luminance stays.
fn white_gains(kelvin: f32, tint: f32) -> [f32; 3] {
    let light = planckian(kelvin);
    let neutral = planckian(6500.0);
    let gains: [f32; 3] = std::array::from_fn(|c| neutral[c] / light[c].max(1e-3));
    let tinted = [
        gains[0] * (1.0 + 0.1 * tint),
        gains[1] * (1.0 - 0.1 * tint),
        gains[2] * (1.0 + 0.1 * tint),
    ];
    let luminance = 0.2126 * tinted[0] + 0.7152 * tinted[1] + 0.0722 * tinted[2];
    tinted.map(|gain| gain / luminance)
}

/// Linear sRGB of a black body, luminance 1: chromaticity by Kim and others (US patent 7024034,
/// 2006), then the matrix of sRGB.
fn planckian(kelvin: f32) -> [f32; 3] {
    let t = kelvin.clamp(1667.0, 25_000.0) as f64;
    let (t1, t2, t3) = (1e3 / t, 1e6 / (t * t), 1e9 / (t * t * t));
    let x = if t <= 4000.0 {
        -0.266_123_9 * t3 - 0.234_358_9 * t2 + 0.877_695_6 * t1 + 0.179_910
    } else {
        -3.025_846_9 * t3 + 2.107_037_9 * t2 + 0.222_634_7 * t1 + 0.240_390
    };
    let (x2, x3) = (x * x, x * x * x);
    let y = if t <= 2222.0 {
        -1.106_381_4 * x3 - 1.348_110_20 * x2 + 2.185_558_32 * x - 0.202_196_83
    } else if t <= 4000.0 {
        -0.954_947_6 * x3 - 1.374_185_93 * x2 + 2.091_370_15 * x - 0.167_488_67
    } else {
        3.081_758_0 * x3 - 5.873_386_70 * x2 + 3.751_129_97 * x - 0.370_014_83
    };
    let (xx, zz) = (x / y, (1.0 - x - y) / y);
    [
        3.2406 * xx - 1.5372 - 0.4986 * zz,
        -0.9689 * xx + 1.8758 + 0.0415 * zz,
        0.0557 * xx - 0.2040 + 1.0570 * zz,
    ]
    .map(|c| c.max(0.0) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Oracle: D65 is sRGB's white, and a black body of 6500 K lies close to it; candle light is
    /// red, the northern sky blue.
    #[test]
    fn black_bodies_have_their_colours() {
        let [r, g, b] = planckian(6500.0);
        assert!(
            (r - 1.0).abs() < 0.06 && (g - 1.0).abs() < 0.03 && (b - 1.0).abs() < 0.06,
            "{r} {g} {b}"
        );
        let [r, _, b] = planckian(2000.0);
        assert!(r > 2.0 && b < 0.2, "{r} {b}");
        let [r, _, b] = planckian(15_000.0);
        assert!(r < 0.85 && b > 1.3, "{r} {b}");
    }

    #[test]
    fn neutral_white_balance_changes_nothing_and_a_high_one_warms() {
        assert!(
            white_gains(6500.0, 0.0)
                .iter()
                .all(|gain| (gain - 1.0).abs() < 1e-5)
        );
        let [r, _, b] = white_gains(10_000.0, 0.0);
        assert!(r > 1.05 && b < 0.95, "{r} {b}");
    }
}
