//! Turns weather into light for the shaders: sun, sky, ambient, air, lamps and exposure.

use nalgebra::Vector3;
use schema_frames::document::Weather;
use sensor_core::Sun;
use sensor_gpu::Gpu;

use super::material;
use super::sky::{MIE_DEPTH, RAYLEIGH_DEPTH, SkyLook, SkyMap, luminance, molecules};
use crate::quality::Quality;
use crate::uniform::{AmbientData, FogData, LightData, SceneryLampsData, SunData, WaterData};

/// Light of one weather.
#[derive(Debug)]
pub(crate) struct Light {
    weather: Weather,
    pub data: LightData,
    /// Direction to the sun.
    pub sun_towards: Vector3<f64>,
    /// Whether the sun throws shadows worth drawing.
    pub has_shadows: bool,
    /// Kilolux to display: 1 is white.
    pub exposure: f32,
    /// How much the scenery's lamps shine: 0 by day, 1 at night.
    pub dark_ratio: f32,
    /// Whether there is fog (rain counts); whether anything is wet.
    pub has_fog: bool,
    pub is_wet: bool,
}

/// The weather's scales on an ordinary clear day.
const RAYLEIGH_USUAL: f32 = 0.0331;
const MIE_USUAL: f32 = 0.03;

/// z of the lowest sun that throws shadows: below it, shadows are longer than the map.
const MIN_SHADOW_SUN_Z: f64 = 0.05;

/// After this time the pattern of rain repeats: its texture has 256 texels, and drops pass 8.8 of
/// them a second.
const RAIN_PERIOD_SECS: f64 = 256.0 / 8.8;

/// Light that lamps add to a street at night, kilolux; cameras expose for it.
const LAMP_LIT_KLX: f32 = 0.010;

/// Radiance of the sun's disc over its irradiance, far below the true 15 000: enough to be white in
/// any picture.
const DISC_GAIN: f32 = 40.0;

/// Cosine of the disc's radius of 0.35°, a little more than the sun's 0.27° so that it does not
/// vanish between pixels.
const DISC_COSINE: f32 = 0.999_981;

impl Light {
    /// Makes the light of `weather`, and its sky.
    pub fn new(quality: Quality, weather: &Weather) -> (Light, SkyMap) {
        let side_px = match quality {
            Quality::Low => 512,
            Quality::High => 1024,
        };
        let (look, exposed) = balance(weather);
        let map = SkyMap::paint(&look, side_px).scaled(exposed.exposure);
        let data = light_data(weather, &look, &exposed, &map);
        let sun_towards = Sun::of(weather).towards;
        let has_shadows = sun_towards.z > MIN_SHADOW_SUN_Z && exposed.sun_share > 0.05;
        let light = Light {
            weather: *weather,
            sun_towards,
            has_shadows,
            exposure: exposed.exposure,
            dark_ratio: exposed.night_ratio,
            has_fog: data.fog.per_m > 0.0,
            is_wet: data.water.wet_ratio > 0.0
                || data.water.rain_ratio > 0.0
                || data.water.puddle_level > 0.0,
            data,
        };
        (light, map)
    }

    /// The light at this time. Only falling rain depends on time; everything else depends on the
    /// weather alone.
    pub fn data_at(&self, sim_secs: f64) -> LightData {
        let mut data = self.data;
        data.water.time_secs = sim_secs.rem_euclid(RAIN_PERIOD_SECS) as f32;
        data
    }

    /// Whether this is the light of `weather`.
    pub fn is_of(&self, weather: &Weather) -> bool {
        self.weather == *weather
    }
}

struct Exposed {
    /// Kilolux to display: 1 is white.
    exposure: f32,
    /// Share of the sun that passes the clouds.
    sun_share: f32,
    /// 0 by day, 1 at night.
    night_ratio: f32,
}

fn smoothstep(low: f32, high: f32, x: f32) -> f32 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Illuminances by sun altitude and clouds.
///
/// Sun: 128 klx outside the air, extinction 0.21 per air mass (Kasten and Young 1989 for the mass).
/// Clear sky: 0.8 + 15.5 √sin h (IES, clear day). Twilight falls by 2.5 per degree.
fn balance(weather: &Weather) -> (SkyLook, Exposed) {
    let towards = Sun::of(weather).towards.map(|x| x as f32);
    let altitude_deg = weather.sun_altitude_deg.clamp(-90.0, 90.0);
    let clouds_ratio = (weather.cloudiness / 100.0).clamp(0.0, 1.0);
    let air_mass =
        1.0 / (towards.z.max(0.0) + 0.50572 * (altitude_deg.max(0.0) + 6.07995).powf(-1.6364));
    let rise = smoothstep(-0.8, 0.6, altitude_deg);
    let sun_klx =
        [0.15, 0.21, 0.34].map(|extinction: f32| 128.0 * (-extinction * air_mass).exp() * rise);
    let twilight = (altitude_deg.min(0.0) * 0.9).exp();
    let clear_klx = (0.8 + 15.5 * towards.z.max(0.0).sqrt()) * twilight;
    let night_ratio = smoothstep(5.0, -4.0, altitude_deg);
    let night_klx = [0.000_45, 0.000_64, 0.001_15].map(|x| x * night_ratio);
    let fog_ratio = (weather.fog_density / 100.0).clamp(0.0, 1.0);
    let dust_ratio = (weather.dust_storm / 100.0).clamp(0.0, 1.0);
    let hidden = 4.0 * fog_ratio * fog_ratio + 3.0 * dust_ratio * dust_ratio;
    let sun_share = (1.0 - 0.25 * clouds_ratio)
        * (1.0 - smoothstep(0.55, 0.95, clouds_ratio))
        * (-hidden).exp();
    let (rayleigh_ratio, mie_ratio) = (
        weather.rayleigh_scattering_scale.max(0.0) / RAYLEIGH_USUAL,
        weather.mie_scattering_scale.max(0.0) / MIE_USUAL,
    );
    // Correction for more or less air in the sun's path than the extinctions above assume.
    let sun_klx = std::array::from_fn(|c| {
        let more = RAYLEIGH_DEPTH[c] * (rayleigh_ratio - 1.0) + MIE_DEPTH * (mie_ratio - 1.0);
        sun_klx[c] * (-more * air_mass).exp()
    });
    let look = SkyLook {
        sun_towards: towards,
        clouds_ratio,
        clear_klx,
        sun_klx,
        night_klx,
        rayleigh_ratio,
        mie_ratio,
    };
    let total_klx = luminance(sun_klx) * towards.z.max(0.0) * sun_share
        + clear_klx * molecules(1, rayleigh_ratio) * (1.0 + 0.6 * clouds_ratio)
        + luminance(sun_klx) * (1.0 - (-2.0 * MIE_DEPTH * (mie_ratio - 1.0).max(0.0)).exp())
        + luminance(night_klx)
        + LAMP_LIT_KLX * night_ratio;
    // Eyes and camera programmes render dim scenes darker; below a kilolux the effect is twice as
    // strong. By night streets are exposed a third of a stop longer than by day.
    let white =
        (1.0 + 0.25 * night_ratio) * (total_klx / 80.0).powf(0.09) * total_klx.min(1.0).powf(0.16);
    (
        look,
        Exposed {
            exposure: white * std::f32::consts::PI / total_klx,
            sun_share,
            night_ratio,
        },
    )
}

/// Light of a moon opposite the sun, in display units, without shadows: a constant for every
/// surface, and a slope towards the moon.
///
/// It is about forty times as bright as a true full moon, as in long exposures. Roads without lamps
/// are then readable in pictures that are exposed for lit streets, at a fifth of their brightness.
struct Moonlight {
    towards: Vector3<f32>,
    constant_rgb: [f32; 3],
    slope_rgb: [f32; 3],
}

/// Irradiance of a surface that faces the moon in a clear night.
const MOON_RGB: [f32; 3] = [0.80, 0.94, 1.25];

impl Moonlight {
    fn of(look: &SkyLook) -> Moonlight {
        let rise = smoothstep(0.0, 0.1, -look.sun_towards.z);
        // Clouds scatter its direct light first.
        let direct = 1.0 - 0.9 * smoothstep(0.4, 0.95, look.clouds_ratio);
        Moonlight {
            towards: -look.sun_towards,
            constant_rgb: MOON_RGB.map(|x| 0.32 * x * rise * (0.6 + 0.4 * direct)),
            slope_rgb: MOON_RGB.map(|x| 0.42 * x * rise * direct),
        }
    }
}

/// Radiance of a lamp that shines by day, and what is added by night.
const LAMP_RADIANCE: f32 = 2.2;
const LAMP_RADIANCE_BY_NIGHT: f32 = 6.0;
/// Radiance of a lit window.
const WINDOW_RADIANCE: f32 = 0.75;
/// Extinction of clear air.
const CLEAR_AIR_PER_M: f32 = 1.0 / 4500.0;
/// Extinction of the densest fog: visibility (5 % contrast) of 67 m at density 100, of 270 m at 50.
const FOG_PER_M: f32 = 0.045;
/// What the strongest rain adds.
const RAIN_PER_M: f32 = 0.0025;
/// Extinction of the densest dust: visibility of 100 m in a storm.
const DUST_PER_M: f32 = 0.039;
/// Upper limit of the way through fog towards the zenith.
const FOG_DEPTH_M: f32 = 150.0;
/// Colour of the light that lamps and windows scatter through a town by night.
const TOWN_RGB: [f32; 3] = [1.0, 0.84, 0.64];
/// Share of the light that the ground throws back.
const GROUND_ALBEDO: f32 = 0.16;
/// Lean of the rain's streaks in the strongest wind.
const RAIN_LEAN: f32 = 0.35;

fn light_data(weather: &Weather, look: &SkyLook, exposed: &Exposed, map: &SkyMap) -> LightData {
    let mut coarse = map.clone();
    while coarse.side_px > 32 {
        coarse = coarse.halved();
    }
    let towards = look.sun_towards;
    let sun = SunData {
        towards: [towards.x, towards.y, towards.z],
        disc_cosine: DISC_COSINE,
        rgb: look
            .sun_klx
            .map(|x| x * exposed.exposure * exposed.sun_share),
        disc_gain: DISC_GAIN,
    };
    LightData {
        sun,
        ambient: ambient(look, exposed, &coarse, sun.rgb),
        fog: fog(weather, exposed, coarse.horizon()),
        water: water(weather),
        lamps: SceneryLampsData {
            on_ratio: exposed.night_ratio,
            windows_on_ratio: exposed.night_ratio,
            radiance: LAMP_RADIANCE + LAMP_RADIANCE_BY_NIGHT * exposed.night_ratio,
            window_radiance: WINDOW_RADIANCE,
        },
        materials: std::array::from_fn(|i| material::LOOKS[i].0),
        mirrors: std::array::from_fn(|i| material::LOOKS[i].1),
        looks: std::array::from_fn(|i| material::in_bytes(material::LOOKS[i])),
    }
}

/// Ambient light: a constant term and its slopes along the world's axes.
fn ambient(look: &SkyLook, exposed: &Exposed, sky: &SkyMap, sun_rgb: [f32; 3]) -> AmbientData {
    let up = sky.irradiance(Vector3::z());
    // Light thrown back by the ground, seen by everything that faces down.
    let ground: [f32; 3] =
        std::array::from_fn(|c| GROUND_ALBEDO * (up[c] + sun_rgb[c] * look.sun_towards.z.max(0.0)));
    let facing = |axis: Vector3<f32>| {
        let sky = sky.irradiance(axis);
        let below = 0.5 * (1.0 - axis.z);
        let grey = luminance(sky);
        // Houses and trees throw back light of every colour: streets are less blue than the sky,
        // and less dark.
        std::array::from_fn::<f32, 3, _>(|c| {
            1.15 * (sky[c] + 0.85 * (grey - sky[c])) + ground[c] * below
        })
    };
    let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
    let pairs = axes.map(|axis| (facing(axis), facing(-axis)));
    let moon = Moonlight::of(look);
    let town = TOWN_RGB.map(|c: f32| c * 0.12 * exposed.night_ratio);
    let constant: [f32; 3] = std::array::from_fn(|c| {
        pairs.iter().map(|(a, b)| a[c] + b[c]).sum::<f32>() / 6.0 + town[c] + moon.constant_rgb[c]
    });
    let slopes: [[f32; 4]; 3] = std::array::from_fn(|i| {
        let ((a, b), along) = (pairs[i], moon.towards.dot(&axes[i]));
        let slope = |c: usize| 0.5 * (a[c] - b[c]) + moon.slope_rgb[c] * along;
        [slope(0), slope(1), slope(2), 0.0]
    });
    // In low quality, mirrors show the zenith as a share of the light on level ground, without the
    // moon's and the lamps' part.
    let level = luminance(std::array::from_fn(|c| constant[c] + slopes[2][c])).max(1e-9);
    let others = luminance(std::array::from_fn(|c| {
        town[c] + moon.constant_rgb[c] + moon.slope_rgb[c] * moon.towards.z
    }));
    AmbientData {
        rgb: constant,
        zenith_ratio: 0.22 * (1.0 - others / level).clamp(0.0, 1.0),
        slope_rgb: slopes,
    }
}

/// Fog, dust and rain in the air, whose colour is that of the sky at the horizon.
fn fog(weather: &Weather, exposed: &Exposed, horizon: [f32; 3]) -> FogData {
    let fog_ratio = (weather.fog_density / 100.0).clamp(0.0, 1.0);
    let dust_ratio = (weather.dust_storm / 100.0).clamp(0.0, 1.0);
    let rain_ratio = (weather.precipitation / 100.0).clamp(0.0, 1.0);
    let dust_per_m = DUST_PER_M * dust_ratio;
    let fog_per_m = FOG_PER_M * fog_ratio * fog_ratio + RAIN_PER_M * rain_ratio + dust_per_m;
    // Falloff 1 reaches the roofs of usual houses, 5 a car's roof, 0 fills the air.
    let falloff_per_m = (0.1 * weather.fog_falloff).clamp(0.0, 2.0);
    let above_m = if falloff_per_m > 1.0 / FOG_DEPTH_M {
        1.0 / falloff_per_m
    } else {
        FOG_DEPTH_M
    };
    let grey = luminance(horizon);
    let fog_rgb = horizon.map(|x| (x + (grey - x) * (0.35 + 0.5 * fog_ratio)) * 0.92);
    // Dust is brown; its share of the colour is its share of the extinction.
    let dusty = dust_per_m / fog_per_m.max(1e-6);
    let brown = [0.95, 0.68, 0.40].map(|c: f32| c * grey * (1.0 - 0.45 * dust_ratio));
    let fog_rgb: [f32; 3] = std::array::from_fn(|c| fog_rgb[c] + (brown[c] - fog_rgb[c]) * dusty);
    // Town lights redden the air at night.
    let glow = [1.0, 0.72, 0.45].map(|c: f32| c * 0.02 * exposed.night_ratio * (0.3 + fog_ratio));
    FogData {
        rgb: std::array::from_fn(|c| fog_rgb[c] + glow[c]),
        begin_m: weather.fog_distance_m.max(0.0) * (1.0 - dusty),
        per_m: fog_per_m,
        falloff_per_m,
        above_m,
        forward_ratio: 0.12 * weather.scattering_intensity.clamp(0.0, 10.0),
        clear_air_per_m: CLEAR_AIR_PER_M,
        unused: [0; 3],
    }
}

/// Rain and what it leaves on the ground.
fn water(weather: &Weather) -> WaterData {
    let wet = (weather
        .wetness
        .max(0.8 * weather.precipitation)
        .max(0.7 * weather.precipitation_deposits)
        / 100.0)
        .clamp(0.0, 1.0);
    let wind_ratio = (weather.wind_intensity / 100.0).clamp(0.0, 1.0);
    let puddle_ratio = (weather.precipitation_deposits / 100.0).clamp(0.0, 1.0);
    WaterData {
        rain_ratio: (weather.precipitation / 100.0).clamp(0.0, 1.0),
        lean: RAIN_LEAN * wind_ratio,
        time_secs: 0.0,
        // The noise's clouds lie about 0.5, most of them within 0.25 of it.
        puddle_level: if puddle_ratio > 0.0 {
            0.30 + 0.26 * puddle_ratio
        } else {
            0.0
        },
        wet_ratio: wet,
        unused: [0; 3],
    }
}

/// The sky on the GPU, with all its mip levels down to 8 × 8.
pub(crate) fn upload_sky(gpu: &Gpu, mut map: SkyMap) -> wgpu::TextureView {
    let n_mips = map.side_px.ilog2() - 2;
    let side_px = map.side_px as u32;
    let usage = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST;
    let texture = gpu.texture(
        "sky",
        [side_px, side_px],
        n_mips,
        wgpu::TextureFormat::Rgba16Float,
        usage,
    );
    for mip_level in 0..n_mips {
        let side_px = map.side_px as u32;
        gpu.queue().write_texture(
            wgpu::TexelCopyTextureInfo {
                texture: &texture,
                mip_level,
                origin: wgpu::Origin3d::ZERO,
                aspect: wgpu::TextureAspect::All,
            },
            bytemuck::cast_slice(&map.texels()),
            wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(8 * side_px),
                rows_per_image: None,
            },
            wgpu::Extent3d {
                width: side_px,
                height: side_px,
                depth_or_array_layers: 1,
            },
        );
        map = map.halved();
    }
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}
