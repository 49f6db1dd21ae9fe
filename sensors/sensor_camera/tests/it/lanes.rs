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
mod expressions;
mod generator;
mod images;
mod inputs;
mod lavapipe;
mod statements;
mod unit;

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use naga::{Module, ScalarKind, TypeInner};
use sensor_camera::{
    AmbientData, FogData, LampData, LightData, SceneryLampsData, SunData, ViewData, WaterData,
    shader_sources,
};
use sensor_core::vector_lanes::{LaneWork, Lanes, WordLanes, in_arrays, in_lanes};
use sensor_gpu::Gpu;
use sensor_shade::packing::word;
use sensor_shade::shading;

use crate::common;
use images::{Images, VIEW_PX};
use unit::Unit;

const CONSTRUCTS: &str = include_str!("lanes/constructs.wgsl");

fn shade_text() -> String {
    let mut sources = shader_sources().into_iter();
    let (_, text) = sources
        .find(|(name, _)| *name == "shade, in lanes")
        .expect("the shader has a name");
    text
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

/// The generated module, and the one that calls its functions by number.
fn generated(text: &str, shade: &str, module: &str) -> Result<[String; 2], String> {
    with_unit(text, |unit| {
        let code = generator::generated(unit, shade)?;
        Ok([code, calls_writer::calls(unit, module)?])
    })
}

#[test]
fn generated_code_is_that_of_the_shaders() {
    let crate_of_lanes = "sensor_shade";
    let shade = generated(&shade_text(), "crate", "sensor_shade::shading");
    let constructs = generated(CONSTRUCTS, crate_of_lanes, "super::constructs");
    let [shade, constructs] =
        [shade, constructs].map(|text| text.unwrap_or_else(|error| panic!("{error}")));
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let files = [
        (&shade[0], "../sensor_shade/src/shading.rs"),
        (&shade[1], "tests/it/lanes/calls.rs"),
        (&constructs[0], "tests/it/lanes/constructs.rs"),
        (&constructs[1], "tests/it/lanes/constructs_calls.rs"),
    ];
    for (text, file) in files {
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
        let error = generated(text, "crate", "m").expect_err(text);
        assert!(
            error.contains(expected),
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
            lens_px: [50.0, 50.0, 32.0, 24.0],
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
                .map(|_| std::array::from_fn(|_| 1 << rng.u32(0..32) | 1 << rng.u32(0..32)))
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

/// Eight calls of a function at once.
struct Eight<'a> {
    number: usize,
    bound: &'a shading::Bound<'a, Images>,
    words: &'a [[u32; 8]],
    running: [u32; 8],
}

impl LaneWork for Eight<'_> {
    type Out = Vec<[u32; 8]>;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Self::Out {
        let words: Vec<L::Words> = self.words.iter().map(|x| <L::Words>::load(x)).collect();
        let lanes = L::not(<L::Words>::load(&self.running).eq(word::<L>(0)));
        let found = calls::call::<L, Images>(self.number, self.bound, lanes, &words);
        found.into_iter().map(WordLanes::store).collect()
    }
}

/// The same for the constructs, which read no image.
struct EightConstructs<'a> {
    number: usize,
    overrides: constructs::Overrides,
    words: &'a [[u32; 8]],
    running: [u32; 8],
}

impl<L: Lanes> constructs::Maps<L> for () {}

impl LaneWork for EightConstructs<'_> {
    type Out = Vec<[u32; 8]>;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Self::Out {
        let words: Vec<L::Words> = self.words.iter().map(|x| <L::Words>::load(x)).collect();
        let lanes = L::not(<L::Words>::load(&self.running).eq(word::<L>(0)));
        let bound = constructs::Bound {
            overrides: self.overrides,
            maps: &(),
        };
        let found = constructs_calls::call::<L, ()>(self.number, &bound, lanes, &words);
        found.into_iter().map(WordLanes::store).collect()
    }
}

/// Rows of eight as columns, and back.
fn columns(rows: &[Vec<u32>]) -> Vec<[u32; 8]> {
    (0..rows[0].len())
        .map(|word| std::array::from_fn(|lane| rows[lane][word]))
        .collect()
}

fn rows_of(columns: &[[u32; 8]]) -> impl Iterator<Item = Vec<u32>> {
    (0..8).map(|lane| columns.iter().map(|column| column[lane]).collect())
}

/// Calls of a function that reads nothing, of the shading or of the constructs.
struct EightPure<'a> {
    is_shading: bool,
    number: usize,
    words: &'a [[u32; 8]],
}

impl LaneWork for EightPure<'_> {
    type Out = Option<Vec<[u32; 8]>>;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Self::Out {
        let words: Vec<L::Words> = self.words.iter().map(|x| <L::Words>::load(x)).collect();
        let lanes = L::mask(true);
        let found = if self.is_shading {
            calls::call_pure::<L>(self.number, lanes, &words)
        } else {
            constructs_calls::call_pure::<L>(self.number, lanes, &words)
        };
        Some(found?.into_iter().map(WordLanes::store).collect())
    }
}

/// What calls of a function give in vectors: the bits of arrays, if it reads nothing, and unchanged
/// by what lanes hold that do not run.
fn in_eights(
    rows: &[Vec<u32>],
    rng: &mut fastrand::Rng,
    call: impl Fn(&[[u32; 8]], [u32; 8]) -> Vec<[u32; 8]>,
    in_arrays: impl Fn(&[[u32; 8]]) -> Option<Vec<[u32; 8]>>,
) -> Vec<Vec<u32>> {
    let mut found = Vec::new();
    for (i, eight) in rows.chunks_exact(8).enumerate() {
        let words = columns(eight);
        let all = call(&words, [1; 8]);
        if i % 8 == 0 {
            if let Some(again) = in_arrays(&words) {
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
            let some = call(&mixed, running);
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
    found: &[Vec<u32>],
    expected: &[u32],
) -> Option<String> {
    let result = function.result.as_ref().expect("there is a result");
    let mut numbers = Vec::new();
    is_number(module, &module.types[result.ty].inner, &mut numbers);
    let is_packed = matches!(name, "packed_color" | "surface_of" | "surface_pixel");
    let mut wrong = Vec::new();
    for (i, found) in found.iter().enumerate() {
        let expected = &expected[i * numbers.len()..(i + 1) * numbers.len()];
        let agrees = numbers
            .iter()
            .zip(found.iter().zip(expected))
            .all(|(number, (a, b))| agree(*number, is_packed, BOUND, *a, *b));
        if !agrees {
            wrong.push(i);
        }
    }
    let different: BTreeSet<&Vec<u32>> = found.iter().collect();
    if name != "sky_pixel" && different.len() < LEAST_DIFFERENT {
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
    let expected = &expected[first * numbers.len()..(first + 1) * numbers.len()];
    let text = format!(
        "{name}: {} of {} rows differ, first\n  of {:?}\n  found    {:?}\n  expected {:?}",
        wrong.len(),
        found.len(),
        texts(&rows[first], &[]),
        texts(&found[first], &numbers),
        texts(expected, &numbers)
    );
    (wrong.len() > OUTLIERS).then_some(text)
}

/// The adapter's results for every function of a shader, compared with those of lanes.
fn compare_all(
    gpu: &Gpu,
    text: &str,
    overrides: &[(&str, f64)],
    resources: &lavapipe::Resources<'_>,
    mut in_lanes: impl FnMut(usize, &[Vec<u32>], &mut fastrand::Rng) -> Vec<Vec<u32>>,
) -> Vec<String> {
    with_unit(text, |unit| {
        // Which functions need overrides is known after they were generated.
        generator::generated(unit, "crate").unwrap_or_else(|error| panic!("{error}"));
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
            let found = in_lanes(number, &rows, &mut rng);
            wrong.extend(compare(&name, module, function, &rows, &found, &expected));
        }
        wrong
    })
}

/// Oracle: the same WGSL on the adapter.
#[test]
fn every_shading_function_does_in_lanes_what_it_does_on_the_adapter() {
    let gpu = common::gpu();
    let text = shade_text();
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
        let wrong = compare_all(&gpu, &text, &constants, &resources, |number, rows, rng| {
            in_eights(
                rows,
                rng,
                |words, running| {
                    in_lanes(Eight {
                        number,
                        bound: &bound,
                        words,
                        running,
                    })
                },
                |words| {
                    in_arrays(EightPure {
                        is_shading: true,
                        number,
                        words,
                    })
                },
            )
        });
        assert!(wrong.is_empty(), "{overrides:?}\n{}", wrong.join("\n"));
    }
}

/// Oracle: the same WGSL on the adapter.
#[test]
fn every_construct_does_in_lanes_what_it_does_on_the_adapter() {
    let gpu = common::gpu();
    let resources = lavapipe::Resources {
        buffers: BTreeMap::new(),
        texture: &|name| panic!("there is no image {name}"),
    };
    for [chosen, other] in [[true, false], [false, false], [true, true]] {
        let constants = [
            ("CHOSEN", chosen as u32 as f64),
            ("OTHER", other as u32 as f64),
        ];
        let overrides = constructs::Overrides { chosen, other };
        let wrong = compare_all(
            &gpu,
            CONSTRUCTS,
            &constants,
            &resources,
            |number, rows, rng| {
                in_eights(
                    rows,
                    rng,
                    |words, running| {
                        in_lanes(EightConstructs {
                            number,
                            overrides,
                            words,
                            running,
                        })
                    },
                    |words| {
                        in_arrays(EightPure {
                            is_shading: false,
                            number,
                            words,
                        })
                    },
                )
            },
        );
        assert!(wrong.is_empty(), "{overrides:?}\n{}", wrong.join("\n"));
    }
}
