//! The code that `sensor_shade` has for processors is generated from the shaders and does what they
//! do on an adapter.

#[rustfmt::skip]
#[allow(dead_code, unused, clippy::all, reason = "generated")]
mod calls;
mod calls_writer;
#[rustfmt::skip]
#[allow(dead_code, unused, clippy::all, reason = "generated")]
mod constructs;
#[rustfmt::skip]
#[allow(dead_code, unused, clippy::all, reason = "generated")]
mod constructs_calls;
mod eight;
mod expressions;
mod generator;
mod images;
mod inputs;
mod lavapipe;
#[rustfmt::skip]
#[allow(dead_code, unused, clippy::all, reason = "generated")]
mod resolving_calls;
mod statements;
mod unit;

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use naga::{Module, ScalarKind, TypeInner};
use sensor_camera::{
    AmbientData, FogData, InstanceData, LampData, LightData, RasterDraw, SceneryLampsData, SunData,
    ViewData, WaterData, shader_sources,
};
use sensor_core::Vertex;
use sensor_core::vector_lanes::Lanes;
use sensor_gpu::Gpu;
use sensor_shade::{resolving, shading};

use crate::common;
use eight::Eight;
use images::{FOCAL_PX, Images, VIEW_PX};
use inputs::{N_INSTANCES, N_TRIANGLES, N_VERTICES};
use unit::{Unit, Written};

/// What is generated: a shader, the functions that are called from outside, and where they go.
struct Generated {
    text: String,
    roots: &'static [&'static str],
    /// The path of `sensor_shade` in the generated code.
    shade: &'static str,
    /// The path of the generated module, its file, and that of its calls.
    module: &'static str,
    /// The path of the maps that its calls are given.
    maps: &'static str,
    files: [&'static str; 2],
}

fn text_of(wanted: &str) -> String {
    let mut sources = shader_sources().into_iter();
    let found = sources.find(|(name, _)| *name == wanted);
    let (_, text) = found.expect("the shader has this name");
    text
}

fn shade() -> Generated {
    Generated {
        text: text_of("shade, in lanes"),
        roots: &["surface_radiance", "sky_at", "packed_color", "luminance_of"],
        shade: "crate",
        module: "sensor_shade::shading",
        maps: "super::images::Images",
        files: ["../sensor_shade/src/shading.rs", "tests/it/lanes/calls.rs"],
    }
}

fn resolve() -> Generated {
    Generated {
        text: text_of("resolve, in lanes"),
        roots: &["pixel_at"],
        shade: "crate",
        module: "sensor_shade::resolving",
        maps: "super::NoMaps",
        files: [
            "../sensor_shade/src/resolving.rs",
            "tests/it/lanes/resolving_calls.rs",
        ],
    }
}

fn constructs() -> Generated {
    Generated {
        text: include_str!("lanes/constructs.wgsl").to_owned(),
        roots: &[
            "rounds",
            "halved",
            "sorted",
            "called_in_branches",
            "whole_numbers",
            "numbers_and_words",
            "functions",
            "vectors",
            "packed",
        ],
        shade: "sensor_shade",
        module: "super::constructs",
        maps: "super::NoMaps",
        files: [
            "tests/it/lanes/constructs.rs",
            "tests/it/lanes/constructs_calls.rs",
        ],
    }
}

fn with_unit<T>(text: &str, f: impl FnOnce(&mut Unit<'_>) -> T) -> T {
    let module = naga::front::wgsl::parse_str(text)
        .unwrap_or_else(|error| panic!("{}", error.emit_to_string(text)));
    let info = naga::valid::Validator::new(
        naga::valid::ValidationFlags::all(),
        naga::valid::Capabilities::empty(),
    )
    .validate(&module)
    .expect("the shader is valid");
    f(&mut Unit::new(&module, &info))
}

impl Generated {
    /// The generated module, and the one that calls its functions by number.
    fn code(&self) -> Written<[String; 2]> {
        with_unit(&self.text, |unit| {
            let code = generator::generated(unit, self.roots, self.shade)?;
            Ok([code, calls_writer::calls(unit, self.module, self.maps)?])
        })
    }
}

#[test]
fn generated_code_is_that_of_the_shaders() {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    for of in [shade(), resolve(), constructs()] {
        let code = of.code().unwrap_or_else(|error| panic!("{error}"));
        for (text, file) in code.iter().zip(of.files) {
            let path = here.join(file);
            if std::env::var_os("GANTRY_BLESS").is_some() {
                std::fs::write(&path, text).expect("generated code can be written");
                continue;
            }
            let written = std::fs::read_to_string(&path).unwrap_or_default();
            assert!(
                written == *text,
                "{} is not what the shaders give: run ./gantry bless",
                path.display()
            );
        }
    }
}

#[test]
fn a_shader_beyond_the_generator_is_refused_with_a_sentence() {
    let cases = [
        (
            "fn f(x: f32) -> f32 { switch i32(x) { case 1: { return 1.0; } default: { return x; } } }",
            "function f: the statement Switch",
        ),
        ("fn f(x: f32) -> f32 { return tan(x); }", "the function Tan"),
        (
            "var<private> p: f32; fn f(x: f32) -> f32 { return x + p; }",
            "p: variables of Private",
        ),
        (
            "fn f(i: u32) -> f32 { var a = array<f32, 3>(1.0, 2.0, 3.0); return a[i]; }",
            "a variable cannot be indexed by lanes",
        ),
    ];
    for (text, expected) in cases {
        let of = Generated {
            text: text.to_owned(),
            roots: &["f"],
            shade: "crate",
            module: "m",
            maps: "m",
            files: [""; 2],
        };
        let error = of.code().expect_err(text);
        assert!(
            error.to_string().contains(expected),
            "{error:?} instead of {expected:?}"
        );
    }
}

/// Uniforms and lists as bytes, with the values of a rainy evening.
struct Evening {
    light: LightData,
    views: Vec<ViewData>,
    lamps: Vec<LampData>,
    lamp_tiles: Vec<[u32; 2]>,
    switched: Vec<[u32; 2]>,
}

impl Evening {
    fn random(rng: &mut fastrand::Rng) -> Evening {
        let light = LightData {
            sun: SunData {
                towards: [0.48, 0.6, 0.64],
                disc_cosine: 0.99996,
                rgb: [2.0, 1.8, 1.5],
                disc_gain: 30.0,
            },
            ambient: AmbientData {
                rgb: [0.4, 0.5, 0.7],
                zenith_ratio: 0.3,
                slope_rgb: [
                    [0.05, 0.04, 0.02, 0.0],
                    [-0.03, 0.02, 0.06, 0.0],
                    [0.2, 0.3, 0.5, 0.0],
                ],
            },
            fog: FogData {
                rgb: [0.5, 0.55, 0.6],
                begin_m: 6.0,
                per_m: 0.01,
                falloff_per_m: 0.05,
                above_m: 40.0,
                forward_ratio: 0.2,
                clear_air_per_m: 0.0004,
                unused: [0; 3],
            },
            water: WaterData {
                rain_ratio: 0.7,
                lean: 0.1,
                time_secs: 3.25,
                puddle_level: 0.6,
                wet_ratio: 0.8,
                unused: [0; 3],
            },
            lamps: SceneryLampsData {
                on_ratio: 0.9,
                windows_on_ratio: 0.6,
                radiance: 4.0,
                window_radiance: 1.5,
            },
            materials: std::array::from_fn(|_| {
                [8.0, 0.3, 2.0, 0.4].map(|most| most * (0.2 + 0.8 * rng.f32()))
            }),
            mirrors: std::array::from_fn(|i| {
                [
                    0.1 * (i % 3) as f32,
                    4.0 * rng.f32(),
                    0.5 * rng.f32(),
                    (i == 14) as u32 as f32,
                ]
            }),
            looks: std::array::from_fn(|_| std::array::from_fn(|_| rng.u32(..))),
        };
        let view = ViewData {
            lens_px: [FOCAL_PX, FOCAL_PX, 32.0, 24.0],
            size_px: VIEW_PX.map(|x| x as f32),
            near_m: 0.1,
            sky_depth_m: 2e9,
            // A camera that looks along x and a little down.
            world_from_camera: [
                [0.0, -0.28, 0.96, 3.0],
                [-1.0, 0.0, 0.0, -4.0],
                [0.0, -0.96, -0.28, 1.6],
            ],
            previous_from_camera: [
                [1.0, 0.0, 0.0, 0.1],
                [0.0, 1.0, 0.0, 0.0],
                [0.0, 0.0, 1.0, 0.2],
            ],
            shadow_from_camera: [
                [0.011, 0.002, 0.004, 0.45],
                [0.001, 0.013, 0.006, 0.4],
                [0.001, 0.002, 0.003, 0.3],
            ],
            far_shadow_from_camera: [
                [0.004, 0.001, 0.003, 0.45],
                [0.001, 0.005, 0.004, 0.4],
                [0.001, 0.001, 0.002, 0.3],
            ],
            turned: 1.0,
            has_shadows: 1.0,
            shadow_texel_depth: 0.004,
            far_shadow_texel_depth: 0.006,
            first_lamp: 2,
            first_lamp_tile: 1,
            // Flow.
            wanted: 1 << 4,
            n_draws: N_DRAWS,
            n_blockers: 2,
            blockers: std::array::from_fn(|half| match half {
                0 => [8.0, 1.0, -1.6, 0.3],
                1 => [0.8, 0.6, 2.2, 0.9],
                2 => [20.0, -6.0, -1.5, 0.9],
                3 => [0.0, 1.0, 0.3, 0.25],
                _ => [0.0; 4],
            }),
            ..bytemuck::Zeroable::zeroed()
        };
        let lamp = |rng: &mut fastrand::Rng| {
            let mut within = |reach: f32| (rng.f32() * 2.0 - 1.0) * reach;
            let place = [within(12.0), within(6.0), 20.0 + within(18.0), 40.0];
            let axis = [within(0.3), 0.9, within(0.3), -0.2];
            LampData {
                place,
                axis,
                rgb: [6.0, 5.0, 3.0, 2.5],
            }
        };
        Evening {
            light,
            views: vec![view; 32],
            lamps: (0..66).map(|_| lamp(rng)).collect(),
            lamp_tiles: (0..5)
                .map(|i| {
                    std::array::from_fn(|_| (0..i).fold(0, |all, _| all | 1 << rng.u32(0..32)))
                })
                .collect(),
            switched: (0..16)
                .map(|_| [rng.u32(..), (0.5 + rng.f32()).to_bits()])
                .collect(),
        }
    }

    fn buffers(&self) -> BTreeMap<&'static str, &[u8]> {
        BTreeMap::from([
            ("light", bytemuck::bytes_of(&self.light)),
            ("views", bytemuck::cast_slice(&self.views)),
            ("lamps", bytemuck::cast_slice(&self.lamps)),
            ("lamp_tiles", bytemuck::cast_slice(&self.lamp_tiles)),
            ("switched", bytemuck::cast_slice(&self.switched)),
        ])
    }

    fn bound<'a, M>(&'a self, maps: &'a M, overrides: shading::Overrides) -> shading::Bound<'a, M> {
        let views: &[u32] = bytemuck::cast_slice(&self.views);
        shading::Bound {
            overrides,
            views: views.first_chunk().expect("there are 32 views"),
            light: bytemuck::cast_ref(&self.light),
            switched: bytemuck::cast_slice(&self.switched),
            lamps: bytemuck::cast_slice(&self.lamps),
            lamp_tiles: bytemuck::cast_slice(&self.lamp_tiles),
            maps,
        }
    }
}

/// Resolving and the constructs read no image.
pub struct NoMaps;

impl<L: Lanes> resolving::Maps<L> for NoMaps {}

impl<L: Lanes> constructs::Maps<L> for NoMaps {}

/// Rows of eight as columns, and back.
fn columns(rows: &[Vec<u32>]) -> Vec<[u32; 8]> {
    (0..rows[0].len())
        .map(|word| std::array::from_fn(|lane| rows[lane][word]))
        .collect()
}

fn rows_of(columns: &[[u32; 8]]) -> impl Iterator<Item = Vec<u32>> {
    (0..8).map(|lane| columns.iter().map(|column| column[lane]).collect())
}

/// What calls of a function give in vectors: the bits of arrays, if it reads nothing, and unchanged
/// by what lanes hold that do not run.
fn in_eights(
    rows: &[Vec<u32>],
    rng: &mut fastrand::Rng,
    call: impl Fn(&Eight<'_>) -> Vec<[u32; 8]>,
    call_in_arrays: impl Fn(&Eight<'_>) -> Option<Vec<[u32; 8]>>,
) -> Vec<Vec<u32>> {
    let mut found = Vec::new();
    for (i, eight) in rows.chunks_exact(8).enumerate() {
        let words = columns(eight);
        let eight_calls = Eight {
            words: &words,
            running: [1; 8],
        };
        let all = call(&eight_calls);
        if i % 8 == 0 {
            if let Some(again) = call_in_arrays(&eight_calls) {
                assert_eq!(all, again, "vectors and arrays differ");
            }
            let running: [u32; 8] = std::array::from_fn(|_| rng.u32(0..2));
            let mixed: Vec<[u32; 8]> = words
                .iter()
                .map(|word| {
                    std::array::from_fn(|lane| match running[lane] {
                        0 => rng.u32(..),
                        _ => word[lane],
                    })
                })
                .collect();
            let some = call(&Eight {
                words: &mixed,
                running,
            });
            for (all, some) in all.iter().zip(&some) {
                for lane in (0..8).filter(|lane| running[*lane] != 0) {
                    assert_eq!(all[lane], some[lane], "a lane changed another");
                }
            }
        }
        found.extend(rows_of(&all));
    }
    found
}

/// Which words of a type are numbers.
fn is_number(module: &Module, inner: &TypeInner, out: &mut Vec<bool>) {
    match inner {
        TypeInner::Array {
            base,
            size: naga::ArraySize::Constant(n),
            ..
        } => (0..n.get()).for_each(|_| is_number(module, &module.types[*base].inner, out)),
        TypeInner::Struct { members, .. } => members
            .iter()
            .for_each(|member| is_number(module, &module.types[member.ty].inner, out)),
        other => {
            let number = other
                .scalar()
                .is_some_and(|of| of.kind == ScalarKind::Float);
            out.extend((0..lavapipe::n_words(module, other)).map(|_| number));
        }
    }
}

/// How far two results may lie apart: numbers by this much of the larger of them and 1; words that
/// are packed from numbers by one in each byte or so, others not at all.
fn agree(is_number: bool, is_packed: bool, bound: f32, a: u32, b: u32) -> bool {
    if is_number {
        let (a, b) = (f32::from_bits(a), f32::from_bits(b));
        let same = a == b || a.is_nan() && b.is_nan();
        return same || (a - b).abs() <= bound * a.abs().max(b.abs()).max(1.0);
    }
    let is_near = |(a, b): (u8, u8)| a.abs_diff(b) <= 1;
    a == b
        || is_packed
            && a.to_le_bytes()
                .into_iter()
                .zip(b.to_le_bytes())
                .all(is_near)
}

/// Draw calls of the lists that resolving reads.
const N_DRAWS: u32 = 5;

const N_ROWS: usize = 2048;

/// Numbers agree to this. The coarsest is noise at places that are ten thousands of texels away, whose
/// fractions have few bits.
const BOUND: f32 = 2e-4;
/// Rounding may decide a comparison, a texel or a step of a march otherwise in so many rows.
const OUTLIERS: usize = 4;
/// Inputs must matter, or agreement would say nothing.
const LEAST_DIFFERENT: usize = 16;

/// Compares rows, and says how many differ.
fn compare(
    name: &str,
    module: &Module,
    function: &naga::Function,
    rows: &[Vec<u32>],
    [found, expected]: [&[Vec<u32>]; 2],
    inputs_matter: bool,
) -> Option<String> {
    let result = function.result.as_ref().expect("there is a result");
    let mut numbers = Vec::new();
    is_number(module, &module.types[result.ty].inner, &mut numbers);
    let is_packed = matches!(
        name,
        "packed_color" | "surface_of" | "surface_pixel" | "seen_pixel" | "pixel_at"
    );
    let mut wrong = Vec::new();
    for (i, found) in found.iter().enumerate() {
        let agrees = numbers
            .iter()
            .zip(found.iter().zip(&expected[i]))
            .all(|(number, (a, b))| agree(*number, is_packed, BOUND, *a, *b));
        if !agrees {
            wrong.push(i);
        }
    }
    let different: BTreeSet<&Vec<u32>> = found.iter().collect();
    let n_least = match name {
        _ if !inputs_matter => 1,
        // Bits, and numbers of list entries.
        "wants" => 2,
        "draw_with" => N_DRAWS as usize,
        "marks_of" => N_INSTANCES as usize,
        // Two boxes, and nothing behind them.
        "blocker_of" => 5,
        _ => LEAST_DIFFERENT,
    };
    if different.len() < n_least {
        return Some(format!("{name} has only {} results", different.len()));
    }
    let first = *wrong.first()?;
    let texts = |words: &[u32], of: &[bool]| -> Vec<String> {
        let both = words.iter().zip(of.iter().chain(std::iter::repeat(&true)));
        both.map(|(word, number)| match number {
            true => format!("{:?}", f32::from_bits(*word)),
            false => format!("{word:#x}"),
        })
        .collect()
    };
    let text = format!(
        "{name}: {} of {} rows differ, first\n  of {:?}\n  found    {:?}\n  expected {:?}",
        wrong.len(),
        found.len(),
        texts(&rows[first], &[]),
        texts(&found[first], &numbers),
        texts(&expected[first], &numbers)
    );
    (wrong.len() > OUTLIERS).then_some(text)
}

/// The adapter's results for every function of a shader, compared with those of lanes. With
/// `inputs_matter`, no override makes a function give always the same.
fn compare_all(
    gpu: &Gpu,
    of: &Generated,
    overrides: &[(&str, f64)],
    inputs_matter: bool,
    resources: &lavapipe::Resources<'_>,
    mut in_lanes: impl FnMut(usize, &[Vec<u32>], &mut fastrand::Rng) -> Vec<Vec<u32>>,
) -> Vec<String> {
    let text = &of.text;
    with_unit(text, |unit| {
        // Which functions there are, and what they need, is known after they were generated.
        let code = generator::generated(unit, of.roots, of.shade);
        code.unwrap_or_else(|error| panic!("{error}"));
        let module = unit.module;
        let mut rng = fastrand::Rng::with_seed(11);
        let mut wrong = Vec::new();
        for (number, (handle, function)) in calls_writer::functions_of(unit).iter().enumerate() {
            let name = unit.function_name(*handle);
            let rows: Vec<Vec<u32>> = (0..N_ROWS)
                .map(|_| inputs::row(&mut rng, module, function))
                .collect();
            let result = function.result.as_ref().expect("there is a result");
            let n_out = lavapipe::n_words(module, &module.types[result.ty].inner);
            let expected = lavapipe::results_on(
                gpu,
                &lavapipe::with_entry(text, module, function),
                overrides,
                resources,
                &rows.concat(),
                [N_ROWS, n_out],
            );
            let expected: Vec<Vec<u32>> = expected.chunks(n_out).map(<[u32]>::to_vec).collect();
            let both = [&in_lanes(number, &rows, &mut rng)[..], &expected];
            wrong.extend(compare(&name, module, function, &rows, both, inputs_matter));
        }
        wrong
    })
}

/// Oracle: the same WGSL on the adapter.
#[test]
fn every_shading_function_does_in_lanes_what_it_does_on_the_adapter() {
    let gpu = common::gpu();
    let shade = shade();
    let mut rng = fastrand::Rng::with_seed(4);
    let evening = Evening::random(&mut rng);
    let images = Images::random(&mut rng);
    let texture = |name: &str| images.texture(&gpu, name);
    let resources = lavapipe::Resources {
        buffers: evening.buffers(),
        texture: &texture,
    };
    // Everything in high quality, everything in low, and a dry day in low.
    for (simple, all) in [(false, true), (true, true), (true, false)] {
        let overrides = shading::Overrides {
            simple,
            with_lamps: all,
            with_fog: all,
            with_wet: all,
            with_switched: all,
        };
        let number = |on: bool| on as u32 as f64;
        let constants = [
            ("SIMPLE", number(simple)),
            ("WITH_LAMPS", number(all)),
            ("WITH_FOG", number(all)),
            ("WITH_WET", number(all)),
            ("WITH_SWITCHED", number(all)),
        ];
        let bound = evening.bound(&images, overrides);
        let wrong = compare_all(
            &gpu,
            &shade,
            &constants,
            !simple,
            &resources,
            |number, rows, rng| {
                in_eights(
                    rows,
                    rng,
                    |eight| calls::call(number, &bound, eight),
                    |eight| calls::call_in_arrays(number, &bound, eight),
                )
            },
        );
        assert!(wrong.is_empty(), "{overrides:?}\n{}", wrong.join("\n"));
    }
}

/// Oracle: the same WGSL on the adapter.
#[test]
fn every_construct_does_in_lanes_what_it_does_on_the_adapter() {
    let gpu = common::gpu();
    let constructs = constructs();
    let resources = lavapipe::Resources {
        buffers: BTreeMap::new(),
        texture: &|name| panic!("there is no image {name}"),
    };
    for [chosen, other] in [[true, false], [false, false], [true, true]] {
        let constants = [
            ("CHOSEN", chosen as u32 as f64),
            ("OTHER", other as u32 as f64),
        ];
        let overrides = self::constructs::Overrides { chosen, other };
        let bound = self::constructs::Bound {
            overrides,
            maps: &NoMaps,
        };
        let wrong = compare_all(
            &gpu,
            &constructs,
            &constants,
            chosen && !other,
            &resources,
            |number, rows, rng| {
                in_eights(
                    rows,
                    rng,
                    |eight| constructs_calls::call(number, &bound, eight),
                    |eight| constructs_calls::call_in_arrays(number, &bound, eight),
                )
            },
        );
        assert!(wrong.is_empty(), "{overrides:?}\n{}", wrong.join("\n"));
    }
}

/// Lists of random triangles for resolving.
struct RandomLists {
    views: Vec<ViewData>,
    instances: Vec<InstanceData>,
    draws: Vec<RasterDraw>,
    vertices: Vec<Vertex>,
    indices: Vec<u32>,
}

impl RandomLists {
    fn new(rng: &mut fastrand::Rng) -> RandomLists {
        let matrix = |rng: &mut fastrand::Rng| -> [[f32; 4]; 3] {
            std::array::from_fn(|_| std::array::from_fn(|_| rng.f32() * 2.0 - 1.0))
        };
        let instance = |rng: &mut fastrand::Rng| {
            let mut camera_from_mesh = matrix(rng);
            camera_from_mesh[2][3] = 8.0;
            let mut previous_from_camera = matrix(rng);
            previous_from_camera[2][2] = 1.0;
            InstanceData {
                camera_from_mesh,
                previous_from_camera,
                world_from_mesh_xyzw: [0.5, -0.5, 0.1, 0.7],
                object_id: rng.u32(..),
                tint: [rng.u8(..), rng.u8(..), rng.u8(..), rng.u8(0..2)],
                lamps: rng.u32(..),
                moved: rng.u32(0..2),
            }
        };
        let vertex = |rng: &mut fastrand::Rng| Vertex {
            position_m: std::array::from_fn(|_| rng.f32() * 8.0 - 4.0),
            normal: std::array::from_fn(|_| rng.i8(-127..=127)),
            color: std::array::from_fn(|_| rng.u8(..)),
            class: rng.u8(0..29),
            material: [10, 14, rng.u8(0..17)][rng.usize(0..3)],
            lamp: rng.u8(0..40),
            reserved: 0,
            object_id: [0, rng.u32(..)][rng.usize(0..2)],
            uv_m: [rng.f32() * 20.0, rng.f32() * 20.0],
        };
        let n_triangles = N_TRIANGLES / N_DRAWS;
        RandomLists {
            views: Evening::random(rng).views,
            instances: (0..N_INSTANCES).map(|_| instance(rng)).collect(),
            draws: (0..N_DRAWS)
                .map(|i| RasterDraw {
                    first_triangle: i * n_triangles,
                    n_triangles,
                    first_idx: 3 * i * n_triangles,
                    base_vertex: rng.u32(0..5),
                    instance: rng.u32(0..N_INSTANCES),
                    view: 0,
                    first_chunk: 0,
                    rest: 0,
                })
                .collect(),
            vertices: (0..N_VERTICES).map(|_| vertex(rng)).collect(),
            indices: (0..3 * N_TRIANGLES)
                .map(|_| rng.u32(0..N_VERTICES - 5))
                .collect(),
        }
    }
}

/// Oracle: the same WGSL on the adapter.
#[test]
fn every_resolving_function_does_in_lanes_what_it_does_on_the_adapter() {
    let gpu = common::gpu();
    let lists = RandomLists::new(&mut fastrand::Rng::with_seed(6));
    let buffers = BTreeMap::from([
        ("views", bytemuck::cast_slice(&lists.views)),
        ("instances", bytemuck::cast_slice(&lists.instances)),
        ("draws", bytemuck::cast_slice(&lists.draws)),
        ("vertices", bytemuck::cast_slice(&lists.vertices)),
        ("indices", bytemuck::cast_slice(&lists.indices)),
    ]);
    let views: &[u32] = bytemuck::cast_slice(&lists.views);
    let bound = resolving::Bound {
        overrides: resolving::Overrides {},
        views: views.first_chunk().expect("there are 32 views"),
        instances: bytemuck::cast_slice(&lists.instances),
        draws: bytemuck::cast_slice(&lists.draws),
        vertices: bytemuck::cast_slice(&lists.vertices),
        indices: &lists.indices,
        maps: &NoMaps,
    };
    let resources = lavapipe::Resources {
        buffers,
        texture: &|name| panic!("there is no image {name}"),
    };
    let wrong = compare_all(
        &gpu,
        &resolve(),
        &[],
        true,
        &resources,
        |number, rows, rng| {
            in_eights(
                rows,
                rng,
                |eight| resolving_calls::call(number, &bound, eight),
                |eight| resolving_calls::call_in_arrays(number, &bound, eight),
            )
        },
    );
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
