/* Layouts and numbers of the frame contract, made from the Rust types by `cargo test -p schema_frames`. Do not edit.
 * schemas/schema_frames/SPEC.md has the rules. Compiling this file checks every size and offset. */
#ifndef GANTRY_LAYOUT_H
#define GANTRY_LAYOUT_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
#define GANTRY_ALIGNED(n) alignas(n)
#define GANTRY_CHECK(is, why) static_assert(is, why)
#else
#define GANTRY_ALIGNED(n) _Alignas(n)
#define GANTRY_CHECK(is, why) _Static_assert(is, why)
#endif

#define GANTRY_SCHEMA_VERSION 1u
#define GANTRY_MAX_INPUTS 8

/* gantry_frame_header.encoding */
enum {
    GANTRY_MODALITY_RGB = 1,
    GANTRY_MODALITY_DEPTH = 2,
    GANTRY_MODALITY_SEMANTIC = 3,
    GANTRY_MODALITY_INSTANCE = 4,
    GANTRY_MODALITY_FLOW = 5,
    GANTRY_MODALITY_NORMALS = 6,
    GANTRY_MODALITY_DVS = 7,
    GANTRY_MODALITY_LIDAR = 8,
    GANTRY_MODALITY_SEMANTIC_LIDAR = 9,
    GANTRY_MODALITY_RADAR = 10,
    GANTRY_MODALITY_IMU = 11,
    GANTRY_MODALITY_GNSS = 12,
    GANTRY_MODALITY_COLLISION = 13,
    GANTRY_MODALITY_LANE_INVASION = 14,
    GANTRY_MODALITY_OBSTACLE = 15,
    GANTRY_MODALITY_LIDAR_RETURNS = 16,
};

/* gantry_result_header.result_type */
enum {
    GANTRY_RESULT_IMAGE = 1,
    GANTRY_RESULT_TENSOR = 2,
    GANTRY_RESULT_BOXES2D = 3,
    GANTRY_RESULT_BOXES3D = 4,
    GANTRY_RESULT_TRACKS = 5,
    GANTRY_RESULT_MASKS = 6,
    GANTRY_RESULT_KEYPOINTS = 7,
    GANTRY_RESULT_FLOW = 8,
    GANTRY_RESULT_DEPTH = 9,
    GANTRY_RESULT_SEMANTIC = 10,
    GANTRY_RESULT_INSTANCE = 11,
    GANTRY_RESULT_POINTS = 12,
    GANTRY_RESULT_POSE = 13,
    GANTRY_RESULT_ODOMETRY = 14,
    GANTRY_RESULT_PATH = 15,
    GANTRY_RESULT_CONTROL = 16,
    GANTRY_RESULT_SCALARS = 17,
    GANTRY_RESULT_TEXT = 18,
    GANTRY_RESULT_JSON = 19,
    GANTRY_RESULT_BYTES = 20,
};

/* gantry_result_header.encoding of pixels */
enum {
    GANTRY_PIXEL_BGRA8 = 1,
    GANTRY_PIXEL_DEPTH = 2,
    GANTRY_PIXEL_CLASS = 3,
    GANTRY_PIXEL_ID = 4,
    GANTRY_PIXEL_FLOW = 5,
    GANTRY_PIXEL_NORMALS = 6,
    GANTRY_PIXEL_BGR8 = 32,
    GANTRY_PIXEL_RGB8 = 33,
    GANTRY_PIXEL_RGBA8 = 34,
    GANTRY_PIXEL_MONO8 = 35,
    GANTRY_PIXEL_MONO16 = 36,
    GANTRY_PIXEL_MONO32F = 37,
};

/* gantry_result_header.encoding of a tensor */
enum {
    GANTRY_ELEMENT_U8 = 1,
    GANTRY_ELEMENT_I8 = 2,
    GANTRY_ELEMENT_U16 = 3,
    GANTRY_ELEMENT_I16 = 4,
    GANTRY_ELEMENT_U32 = 5,
    GANTRY_ELEMENT_I32 = 6,
    GANTRY_ELEMENT_U64 = 7,
    GANTRY_ELEMENT_I64 = 8,
    GANTRY_ELEMENT_F16 = 9,
    GANTRY_ELEMENT_F32 = 10,
    GANTRY_ELEMENT_F64 = 11,
    GANTRY_ELEMENT_BOOL = 12,
};

/* gantry_result_header.space */
enum {
    GANTRY_SPACE_NONE = 0,
    GANTRY_SPACE_IMAGE = 1,
    GANTRY_SPACE_SENSOR = 2,
    GANTRY_SPACE_VEHICLE = 3,
    GANTRY_SPACE_WORLD = 4,
};

/* gantry_actor_record.kind; it says what `part` holds */
enum {
    GANTRY_ACTOR_VEHICLE = 1,
    GANTRY_ACTOR_WALKER = 2,
    GANTRY_ACTOR_TRAFFIC_LIGHT = 3,
    GANTRY_ACTOR_TRAFFIC_SIGN = 4,
    GANTRY_ACTOR_PROP = 5,
    GANTRY_ACTOR_SENSOR = 6,
    GANTRY_ACTOR_SPECTATOR = 7,
    GANTRY_ACTOR_CONTROLLER = 8,
};

/* gantry_traffic_light_part.state */
enum {
    GANTRY_LIGHT_RED = 0,
    GANTRY_LIGHT_YELLOW = 1,
    GANTRY_LIGHT_GREEN = 2,
    GANTRY_LIGHT_OFF = 3,
    GANTRY_LIGHT_UNKNOWN = 4,
};

/* Semantic classes, CARLA's numbers. */
enum {
    GANTRY_CLASS_UNLABELED = 0,
    GANTRY_CLASS_ROADS = 1,
    GANTRY_CLASS_SIDEWALKS = 2,
    GANTRY_CLASS_BUILDINGS = 3,
    GANTRY_CLASS_WALLS = 4,
    GANTRY_CLASS_FENCES = 5,
    GANTRY_CLASS_POLES = 6,
    GANTRY_CLASS_TRAFFIC_LIGHT = 7,
    GANTRY_CLASS_TRAFFIC_SIGNS = 8,
    GANTRY_CLASS_VEGETATION = 9,
    GANTRY_CLASS_TERRAIN = 10,
    GANTRY_CLASS_SKY = 11,
    GANTRY_CLASS_PEDESTRIANS = 12,
    GANTRY_CLASS_RIDER = 13,
    GANTRY_CLASS_CAR = 14,
    GANTRY_CLASS_TRUCK = 15,
    GANTRY_CLASS_BUS = 16,
    GANTRY_CLASS_TRAIN = 17,
    GANTRY_CLASS_MOTORCYCLE = 18,
    GANTRY_CLASS_BICYCLE = 19,
    GANTRY_CLASS_STATIC = 20,
    GANTRY_CLASS_DYNAMIC = 21,
    GANTRY_CLASS_OTHER = 22,
    GANTRY_CLASS_WATER = 23,
    GANTRY_CLASS_ROAD_LINES = 24,
    GANTRY_CLASS_GROUND = 25,
    GANTRY_CLASS_BRIDGE = 26,
    GANTRY_CLASS_RAIL_TRACK = 27,
    GANTRY_CLASS_GUARD_RAIL = 28,
};

typedef struct gantry_pose {
    /* Position of the source's origin in the target, metres. */
    double translation_m[3];
    /* Unit quaternion, [x, y, z, w]. */
    double rotation_xyzw[4];
} gantry_pose;
GANTRY_CHECK(sizeof(gantry_pose) == 56, "gantry_pose has another size");
GANTRY_CHECK(offsetof(gantry_pose, translation_m) == 0, "gantry_pose.translation_m is elsewhere");
GANTRY_CHECK(offsetof(gantry_pose, rotation_xyzw) == 24, "gantry_pose.rotation_xyzw is elsewhere");

typedef struct gantry_frame_header {
    /* FRAME_MAGIC. */
    GANTRY_ALIGNED(64) uint32_t magic;
    /* SCHEMA_VERSION. */
    uint16_t schema_version;
    /* 256. */
    uint16_t header_bytes;
    /* Actor id of the sensor. */
    uint32_t sensor_id;
    /* SensorKind number. */
    uint16_t kind;
    /* Modality number. */
    uint16_t encoding;
    /* Tick this frame shows. */
    uint64_t tick;
    /* Simulated time this frame shows, nanoseconds since the daemon started. */
    uint64_t sim_nanos;
    /* Number of the sensor's firing, from 1. Scheduled firings count whether anybody reads or not (of event-like sensors: ticks with events), so a gap is a loss. */
    uint64_t seq;
    /* Count of map loads in this epoch, from 1. */
    uint32_t episode;
    /* Bit 0 FrameHeader::FIRST, bit 1 FrameHeader::REPLAYED, bit 2 FrameHeader::SEALED. */
    uint32_t flags;
    /* Payload bytes in use; the sample may be longer. */
    uint64_t payload_bytes;
    /* Pixels per row, or elements of a list. */
    uint32_t width;
    /* Rows, of a batch those of all its images; 1 for a list. */
    uint32_t height;
    /* Bytes from one row to the next. */
    uint32_t row_stride;
    /* Bytes of one pixel or list element. */
    uint32_t element_bytes;
    /* Time this frame covers, ending at sim_nanos: of flow, DVS, lidar sweeps and events. */
    uint64_t window_nanos;
    /* Pose of the sensor in the world (sensor axes: x forward, y left, z up). */
    gantry_pose world_from_sensor;
    /* Focal length and principal point [fx, fy, cx, cy] of a pinhole, pixels; 0 where it has no meaning, as through a lens that optics names. */
    double intrinsics_px[4];
    /* Farthest distance the sensor reports, metres; 0 if unbounded. */
    float range_limit_m;
    /* Azimuth of a lidar's head at the end of the frame, radians, counter-clockwise from x. */
    float azimuth_rad;
    /* Actor the sensor is mounted on; 0 if free. */
    uint32_t parent_id;
    /* Channels of a lidar; 0 otherwise. */
    uint32_t n_channels;
    /* Images of a batch, one below the other; 0 in a frame of a single sensor. */
    uint32_t n_images;
    /* Bits 0 to 7: the lens's model, 0 without one: 1 pinhole, 2 opencv, 3 unified, 4 kannala_brandt, 5 ftheta, 6 equidistant, 7 equisolid, 8 stereographic, 9 orthographic, 10 double_sphere, 11 table. Bit 16: depth is the distance along the ray, not along the optical axis. */
    uint32_t optics;
    /* Random number of the daemon's start. From here on nothing takes part in hashes. */
    uint64_t epoch;
    /* CLOCK_MONOTONIC when the bytes were complete: the GPU's fence was signalled, or the CPU was done. */
    uint64_t rendered_mono_nanos;
    /* CLOCK_MONOTONIC just before the sample was sent. */
    uint64_t published_mono_nanos;
    /* Copies by the CPU on the way into this sample; 0 if the GPU wrote into it. */
    uint32_t cpu_copies;
    /* Ticks that had begun after its own when this frame was sent; 0 outside free-running mode. */
    uint32_t ticks_in_flight;
    /* 0: the payload is in this sample. 1: it is on the GPU, and the sample holds a GpuPlace. */
    uint32_t payload_place;
    /* The lens's Distortion [k, k_cubed, size x, size y]: at p (−0.5 to 0.5) is what a pinhole has at p · (1 + k r² + k_cubed r³), r being the length of p · size. All 0 for a pinhole; NaN if optics names a model, which these four cannot say. */
    float lens[4];
    /* Zero. */
    uint8_t reserved1[8];
    /* If optics names a model: the CRC-32 (IEEE 802.3) of width, height, model, fx, fy, shears of x and y, cx, cy, the field's greatest angle in radians, and the model's own numbers in the order of its keys (those left out at the end are not counted), each an f64; else 0. world/info has these numbers. */
    uint32_t calibration_crc;
} gantry_frame_header;
GANTRY_CHECK(sizeof(gantry_frame_header) == 256, "gantry_frame_header has another size");
GANTRY_CHECK(offsetof(gantry_frame_header, magic) == 0, "gantry_frame_header.magic is elsewhere");
GANTRY_CHECK(offsetof(gantry_frame_header, schema_version) == 4, "gantry_frame_header.schema_version is elsewhere");
GANTRY_CHECK(offsetof(gantry_frame_header, header_bytes) == 6, "gantry_frame_header.header_bytes is elsewhere");
GANTRY_CHECK(offsetof(gantry_frame_header, sensor_id) == 8, "gantry_frame_header.sensor_id is elsewhere");
GANTRY_CHECK(offsetof(gantry_frame_header, kind) == 12, "gantry_frame_header.kind is elsewhere");
GANTRY_CHECK(offsetof(gantry_frame_header, encoding) == 14, "gantry_frame_header.encoding is elsewhere");
GANTRY_CHECK(offsetof(gantry_frame_header, tick) == 16, "gantry_frame_header.tick is elsewhere");
GANTRY_CHECK(offsetof(gantry_frame_header, sim_nanos) == 24, "gantry_frame_header.sim_nanos is elsewhere");
GANTRY_CHECK(offsetof(gantry_frame_header, seq) == 32, "gantry_frame_header.seq is elsewhere");
GANTRY_CHECK(offsetof(gantry_frame_header, episode) == 40, "gantry_frame_header.episode is elsewhere");
GANTRY_CHECK(offsetof(gantry_frame_header, flags) == 44, "gantry_frame_header.flags is elsewhere");
GANTRY_CHECK(offsetof(gantry_frame_header, payload_bytes) == 48, "gantry_frame_header.payload_bytes is elsewhere");
GANTRY_CHECK(offsetof(gantry_frame_header, width) == 56, "gantry_frame_header.width is elsewhere");
GANTRY_CHECK(offsetof(gantry_frame_header, height) == 60, "gantry_frame_header.height is elsewhere");
GANTRY_CHECK(offsetof(gantry_frame_header, row_stride) == 64, "gantry_frame_header.row_stride is elsewhere");
GANTRY_CHECK(offsetof(gantry_frame_header, element_bytes) == 68, "gantry_frame_header.element_bytes is elsewhere");
GANTRY_CHECK(offsetof(gantry_frame_header, window_nanos) == 72, "gantry_frame_header.window_nanos is elsewhere");
GANTRY_CHECK(offsetof(gantry_frame_header, world_from_sensor) == 80, "gantry_frame_header.world_from_sensor is elsewhere");
GANTRY_CHECK(offsetof(gantry_frame_header, intrinsics_px) == 136, "gantry_frame_header.intrinsics_px is elsewhere");
GANTRY_CHECK(offsetof(gantry_frame_header, range_limit_m) == 168, "gantry_frame_header.range_limit_m is elsewhere");
GANTRY_CHECK(offsetof(gantry_frame_header, azimuth_rad) == 172, "gantry_frame_header.azimuth_rad is elsewhere");
GANTRY_CHECK(offsetof(gantry_frame_header, parent_id) == 176, "gantry_frame_header.parent_id is elsewhere");
GANTRY_CHECK(offsetof(gantry_frame_header, n_channels) == 180, "gantry_frame_header.n_channels is elsewhere");
GANTRY_CHECK(offsetof(gantry_frame_header, n_images) == 184, "gantry_frame_header.n_images is elsewhere");
GANTRY_CHECK(offsetof(gantry_frame_header, optics) == 188, "gantry_frame_header.optics is elsewhere");
GANTRY_CHECK(offsetof(gantry_frame_header, epoch) == 192, "gantry_frame_header.epoch is elsewhere");
GANTRY_CHECK(offsetof(gantry_frame_header, rendered_mono_nanos) == 200, "gantry_frame_header.rendered_mono_nanos is elsewhere");
GANTRY_CHECK(offsetof(gantry_frame_header, published_mono_nanos) == 208, "gantry_frame_header.published_mono_nanos is elsewhere");
GANTRY_CHECK(offsetof(gantry_frame_header, cpu_copies) == 216, "gantry_frame_header.cpu_copies is elsewhere");
GANTRY_CHECK(offsetof(gantry_frame_header, ticks_in_flight) == 220, "gantry_frame_header.ticks_in_flight is elsewhere");
GANTRY_CHECK(offsetof(gantry_frame_header, payload_place) == 224, "gantry_frame_header.payload_place is elsewhere");
GANTRY_CHECK(offsetof(gantry_frame_header, lens) == 228, "gantry_frame_header.lens is elsewhere");
GANTRY_CHECK(offsetof(gantry_frame_header, reserved1) == 244, "gantry_frame_header.reserved1 is elsewhere");
GANTRY_CHECK(offsetof(gantry_frame_header, calibration_crc) == 252, "gantry_frame_header.calibration_crc is elsewhere");

typedef struct gantry_dvs_event {
    /* Nanoseconds since the frame's window began (sim_nanos − window_nanos). */
    uint32_t nanos_in_window;
    /* Pixel column. */
    uint16_t x_px;
    /* Pixel row. */
    uint16_t y_px;
    /* Object id at this pixel when the window ended. */
    uint32_t object_id;
    /* 1: brighter, 0: darker. */
    uint8_t polarity;
    /* Class at this pixel when the window ended. */
    uint8_t class_;
    /* Zero. */
    uint16_t reserved;
} gantry_dvs_event;
GANTRY_CHECK(sizeof(gantry_dvs_event) == 16, "gantry_dvs_event has another size");
GANTRY_CHECK(offsetof(gantry_dvs_event, nanos_in_window) == 0, "gantry_dvs_event.nanos_in_window is elsewhere");
GANTRY_CHECK(offsetof(gantry_dvs_event, x_px) == 4, "gantry_dvs_event.x_px is elsewhere");
GANTRY_CHECK(offsetof(gantry_dvs_event, y_px) == 6, "gantry_dvs_event.y_px is elsewhere");
GANTRY_CHECK(offsetof(gantry_dvs_event, object_id) == 8, "gantry_dvs_event.object_id is elsewhere");
GANTRY_CHECK(offsetof(gantry_dvs_event, polarity) == 12, "gantry_dvs_event.polarity is elsewhere");
GANTRY_CHECK(offsetof(gantry_dvs_event, class_) == 13, "gantry_dvs_event.class_ is elsewhere");
GANTRY_CHECK(offsetof(gantry_dvs_event, reserved) == 14, "gantry_dvs_event.reserved is elsewhere");

typedef struct gantry_lidar_point {
    /* Hit point in the sensor's space (x forward, y left, z up), metres. */
    float hit_in_sensor_m[3];
    /* Received over emitted energy; 0..=65535 maps to 0..=1. */
    uint16_t intensity;
    /* Beam number, 0 is the highest elevation. */
    uint16_t channel;
} gantry_lidar_point;
GANTRY_CHECK(sizeof(gantry_lidar_point) == 16, "gantry_lidar_point has another size");
GANTRY_CHECK(offsetof(gantry_lidar_point, hit_in_sensor_m) == 0, "gantry_lidar_point.hit_in_sensor_m is elsewhere");
GANTRY_CHECK(offsetof(gantry_lidar_point, intensity) == 12, "gantry_lidar_point.intensity is elsewhere");
GANTRY_CHECK(offsetof(gantry_lidar_point, channel) == 14, "gantry_lidar_point.channel is elsewhere");

typedef struct gantry_semantic_lidar_point {
    /* Hit point in the sensor's space (x forward, y left, z up), metres. */
    float hit_in_sensor_m[3];
    /* Cosine between the incoming ray and the surface normal; 1 is head-on. */
    float cos_incidence;
    /* Object hit. */
    uint32_t object_id;
    /* Class hit. */
    uint8_t class_;
    /* Zero. */
    uint8_t reserved;
    /* Beam number, 0 is the highest elevation. */
    uint16_t channel;
} gantry_semantic_lidar_point;
GANTRY_CHECK(sizeof(gantry_semantic_lidar_point) == 24, "gantry_semantic_lidar_point has another size");
GANTRY_CHECK(offsetof(gantry_semantic_lidar_point, hit_in_sensor_m) == 0, "gantry_semantic_lidar_point.hit_in_sensor_m is elsewhere");
GANTRY_CHECK(offsetof(gantry_semantic_lidar_point, cos_incidence) == 12, "gantry_semantic_lidar_point.cos_incidence is elsewhere");
GANTRY_CHECK(offsetof(gantry_semantic_lidar_point, object_id) == 16, "gantry_semantic_lidar_point.object_id is elsewhere");
GANTRY_CHECK(offsetof(gantry_semantic_lidar_point, class_) == 20, "gantry_semantic_lidar_point.class_ is elsewhere");
GANTRY_CHECK(offsetof(gantry_semantic_lidar_point, reserved) == 21, "gantry_semantic_lidar_point.reserved is elsewhere");
GANTRY_CHECK(offsetof(gantry_semantic_lidar_point, channel) == 22, "gantry_semantic_lidar_point.channel is elsewhere");

typedef struct gantry_lidar_return {
    /* Hit point in the sensor's space (x forward, y left, z up) at the time of the firing, metres. */
    float hit_in_sensor_m[3];
    /* Time of the firing, nanoseconds from sim_nanos; never positive. */
    int32_t time_ns;
    /* Object hit. */
    uint32_t object_id;
    /* Received over emitted energy; 0..=65535 maps to 0..=1. */
    uint16_t intensity;
    /* Number of the beam as the maker counts. */
    uint16_t ring;
    /* Reflectivity of the surface in the maker's units; 0 where it is not measured. */
    uint8_t reflectivity;
    /* Bits 0–3: which return of its firing, from 0; bits 4–7: how many the firing has. */
    uint8_t returns;
    /* Class hit. */
    uint8_t class_;
    /* Bit 0: from the air (rain, fog, dust); 1: mirrored; 2: retro-reflector; 3: saturated. */
    uint8_t flags;
    /* Ambient light in the maker's units; 0 where it is not measured. */
    uint16_t ambient;
    /* Low 16 bits of the measured range in whole millimetres. */
    uint16_t range_mm_lsb;
} gantry_lidar_return;
GANTRY_CHECK(sizeof(gantry_lidar_return) == 32, "gantry_lidar_return has another size");
GANTRY_CHECK(offsetof(gantry_lidar_return, hit_in_sensor_m) == 0, "gantry_lidar_return.hit_in_sensor_m is elsewhere");
GANTRY_CHECK(offsetof(gantry_lidar_return, time_ns) == 12, "gantry_lidar_return.time_ns is elsewhere");
GANTRY_CHECK(offsetof(gantry_lidar_return, object_id) == 16, "gantry_lidar_return.object_id is elsewhere");
GANTRY_CHECK(offsetof(gantry_lidar_return, intensity) == 20, "gantry_lidar_return.intensity is elsewhere");
GANTRY_CHECK(offsetof(gantry_lidar_return, ring) == 22, "gantry_lidar_return.ring is elsewhere");
GANTRY_CHECK(offsetof(gantry_lidar_return, reflectivity) == 24, "gantry_lidar_return.reflectivity is elsewhere");
GANTRY_CHECK(offsetof(gantry_lidar_return, returns) == 25, "gantry_lidar_return.returns is elsewhere");
GANTRY_CHECK(offsetof(gantry_lidar_return, class_) == 26, "gantry_lidar_return.class_ is elsewhere");
GANTRY_CHECK(offsetof(gantry_lidar_return, flags) == 27, "gantry_lidar_return.flags is elsewhere");
GANTRY_CHECK(offsetof(gantry_lidar_return, ambient) == 28, "gantry_lidar_return.ambient is elsewhere");
GANTRY_CHECK(offsetof(gantry_lidar_return, range_mm_lsb) == 30, "gantry_lidar_return.range_mm_lsb is elsewhere");

typedef struct gantry_radar_detection {
    /* Rate at which the distance grows, m/s: velocity of what was hit minus the radar's own, along the ray; negative if it comes nearer. */
    float velocity_mps;
    /* Direction in the sensor's xy plane, radians counter-clockwise from x (positive to the left). */
    float azimuth_rad;
    /* Direction above the sensor's xy plane, radians. */
    float altitude_rad;
    /* Distance along the ray, metres. */
    float depth_m;
    /* Cosine between the incoming ray and the surface normal; 1 is head-on. */
    float cos_incidence;
    /* Object hit. */
    uint32_t object_id;
    /* Class hit. */
    uint8_t class_;
    /* Zero. */
    uint8_t reserved[7];
} gantry_radar_detection;
GANTRY_CHECK(sizeof(gantry_radar_detection) == 32, "gantry_radar_detection has another size");
GANTRY_CHECK(offsetof(gantry_radar_detection, velocity_mps) == 0, "gantry_radar_detection.velocity_mps is elsewhere");
GANTRY_CHECK(offsetof(gantry_radar_detection, azimuth_rad) == 4, "gantry_radar_detection.azimuth_rad is elsewhere");
GANTRY_CHECK(offsetof(gantry_radar_detection, altitude_rad) == 8, "gantry_radar_detection.altitude_rad is elsewhere");
GANTRY_CHECK(offsetof(gantry_radar_detection, depth_m) == 12, "gantry_radar_detection.depth_m is elsewhere");
GANTRY_CHECK(offsetof(gantry_radar_detection, cos_incidence) == 16, "gantry_radar_detection.cos_incidence is elsewhere");
GANTRY_CHECK(offsetof(gantry_radar_detection, object_id) == 20, "gantry_radar_detection.object_id is elsewhere");
GANTRY_CHECK(offsetof(gantry_radar_detection, class_) == 24, "gantry_radar_detection.class_ is elsewhere");
GANTRY_CHECK(offsetof(gantry_radar_detection, reserved) == 25, "gantry_radar_detection.reserved is elsewhere");

typedef struct gantry_imu_sample {
    /* Specific force in the sensor's space, m/s²; at rest and level z reads +9.81. */
    double specific_force_mps2[3];
    /* Angular velocity in the sensor's space, rad/s. */
    double angular_velocity_radps[3];
    /* Heading of the sensor's forward axis, radians clockwise from north (world +y), in [0, 2π). */
    double compass_rad;
    /* Zero. */
    uint64_t reserved[2];
} gantry_imu_sample;
GANTRY_CHECK(sizeof(gantry_imu_sample) == 72, "gantry_imu_sample has another size");
GANTRY_CHECK(offsetof(gantry_imu_sample, specific_force_mps2) == 0, "gantry_imu_sample.specific_force_mps2 is elsewhere");
GANTRY_CHECK(offsetof(gantry_imu_sample, angular_velocity_radps) == 24, "gantry_imu_sample.angular_velocity_radps is elsewhere");
GANTRY_CHECK(offsetof(gantry_imu_sample, compass_rad) == 48, "gantry_imu_sample.compass_rad is elsewhere");
GANTRY_CHECK(offsetof(gantry_imu_sample, reserved) == 56, "gantry_imu_sample.reserved is elsewhere");

typedef struct gantry_gnss_sample {
    /* Latitude, degrees (geodesy's own unit). */
    double latitude_deg;
    /* Longitude, degrees. */
    double longitude_deg;
    /* Altitude, metres. */
    double altitude_m;
    /* Zero. */
    uint64_t reserved[2];
} gantry_gnss_sample;
GANTRY_CHECK(sizeof(gantry_gnss_sample) == 40, "gantry_gnss_sample has another size");
GANTRY_CHECK(offsetof(gantry_gnss_sample, latitude_deg) == 0, "gantry_gnss_sample.latitude_deg is elsewhere");
GANTRY_CHECK(offsetof(gantry_gnss_sample, longitude_deg) == 8, "gantry_gnss_sample.longitude_deg is elsewhere");
GANTRY_CHECK(offsetof(gantry_gnss_sample, altitude_m) == 16, "gantry_gnss_sample.altitude_m is elsewhere");
GANTRY_CHECK(offsetof(gantry_gnss_sample, reserved) == 24, "gantry_gnss_sample.reserved is elsewhere");

typedef struct gantry_collision_event {
    /* Actor that was touched; 0 is scenery. */
    uint32_t other_id;
    /* Class of what was touched, in scenery the hardest contact; 0 for ground without one. */
    uint8_t class_;
    /* Zero. */
    uint8_t reserved[3];
    /* Impulse on the carrier, summed over the tick, N·s; it points away from what was touched. */
    double impulse_in_world_ns[3];
    /* Mean of the contact points, weighted with their impulses, metres. */
    double point_in_world_m[3];
    /* Zero. */
    uint64_t reserved1;
} gantry_collision_event;
GANTRY_CHECK(sizeof(gantry_collision_event) == 64, "gantry_collision_event has another size");
GANTRY_CHECK(offsetof(gantry_collision_event, other_id) == 0, "gantry_collision_event.other_id is elsewhere");
GANTRY_CHECK(offsetof(gantry_collision_event, class_) == 4, "gantry_collision_event.class_ is elsewhere");
GANTRY_CHECK(offsetof(gantry_collision_event, reserved) == 5, "gantry_collision_event.reserved is elsewhere");
GANTRY_CHECK(offsetof(gantry_collision_event, impulse_in_world_ns) == 8, "gantry_collision_event.impulse_in_world_ns is elsewhere");
GANTRY_CHECK(offsetof(gantry_collision_event, point_in_world_m) == 32, "gantry_collision_event.point_in_world_m is elsewhere");
GANTRY_CHECK(offsetof(gantry_collision_event, reserved1) == 56, "gantry_collision_event.reserved1 is elsewhere");

typedef struct gantry_lane_crossing {
    /* 1 solid, 2 broken, 3 solid solid, 4 solid broken, 5 broken solid, 6 broken broken, 7 Botts' dots, 8 grass, 9 kerb, 10 other. */
    uint8_t mark;
    /* 0 white, 1 yellow, 2 blue, 3 green, 4 red, 5 orange, 6 violet. */
    uint8_t colour;
    /* Lane changes that the mark allows, seen along rising s of the road: bit 0 to the right, bit 1 to the left. */
    uint8_t lane_change;
    /* OpenDRIVE's id of the lane whose outer edge is marked; 0 is the road's centre line. */
    int8_t lane;
    /* Width of the line, metres. */
    float width_m;
    /* OpenDRIVE's road id if that is a number; otherwise a number above all such ids, assigned by the simulator. */
    uint32_t road;
    /* Nanoseconds since the tick began (sim_nanos − window_nanos) at which the first corner crossed. */
    uint32_t nanos_in_window;
    /* Place of the crossing, world, metres. */
    float crossing_in_world_m[3];
    /* Zero. */
    uint32_t reserved;
} gantry_lane_crossing;
GANTRY_CHECK(sizeof(gantry_lane_crossing) == 32, "gantry_lane_crossing has another size");
GANTRY_CHECK(offsetof(gantry_lane_crossing, mark) == 0, "gantry_lane_crossing.mark is elsewhere");
GANTRY_CHECK(offsetof(gantry_lane_crossing, colour) == 1, "gantry_lane_crossing.colour is elsewhere");
GANTRY_CHECK(offsetof(gantry_lane_crossing, lane_change) == 2, "gantry_lane_crossing.lane_change is elsewhere");
GANTRY_CHECK(offsetof(gantry_lane_crossing, lane) == 3, "gantry_lane_crossing.lane is elsewhere");
GANTRY_CHECK(offsetof(gantry_lane_crossing, width_m) == 4, "gantry_lane_crossing.width_m is elsewhere");
GANTRY_CHECK(offsetof(gantry_lane_crossing, road) == 8, "gantry_lane_crossing.road is elsewhere");
GANTRY_CHECK(offsetof(gantry_lane_crossing, nanos_in_window) == 12, "gantry_lane_crossing.nanos_in_window is elsewhere");
GANTRY_CHECK(offsetof(gantry_lane_crossing, crossing_in_world_m) == 16, "gantry_lane_crossing.crossing_in_world_m is elsewhere");
GANTRY_CHECK(offsetof(gantry_lane_crossing, reserved) == 28, "gantry_lane_crossing.reserved is elsewhere");

typedef struct gantry_obstacle_event {
    /* Distance that the ball's centre travels until the ball touches something, metres; 0 if it touches at its start. */
    float distance_m;
    /* Object touched. */
    uint32_t object_id;
    /* Class touched. */
    uint8_t class_;
    /* Zero. */
    uint8_t reserved[3];
    /* Point of contact in the sensor's space, metres. */
    float contact_in_sensor_m[3];
    /* Zero. */
    uint32_t reserved1[2];
} gantry_obstacle_event;
GANTRY_CHECK(sizeof(gantry_obstacle_event) == 32, "gantry_obstacle_event has another size");
GANTRY_CHECK(offsetof(gantry_obstacle_event, distance_m) == 0, "gantry_obstacle_event.distance_m is elsewhere");
GANTRY_CHECK(offsetof(gantry_obstacle_event, object_id) == 4, "gantry_obstacle_event.object_id is elsewhere");
GANTRY_CHECK(offsetof(gantry_obstacle_event, class_) == 8, "gantry_obstacle_event.class_ is elsewhere");
GANTRY_CHECK(offsetof(gantry_obstacle_event, reserved) == 9, "gantry_obstacle_event.reserved is elsewhere");
GANTRY_CHECK(offsetof(gantry_obstacle_event, contact_in_sensor_m) == 12, "gantry_obstacle_event.contact_in_sensor_m is elsewhere");
GANTRY_CHECK(offsetof(gantry_obstacle_event, reserved1) == 24, "gantry_obstacle_event.reserved1 is elsewhere");

typedef struct gantry_snapshot_header {
    /* SNAPSHOT_MAGIC. */
    GANTRY_ALIGNED(64) uint32_t magic;
    /* SCHEMA_VERSION. */
    uint16_t schema_version;
    /* 128. */
    uint16_t header_bytes;
    /* Tick this snapshot shows. */
    uint64_t tick;
    /* Simulated time, nanoseconds since the daemon started. */
    uint64_t sim_nanos;
    /* Simulated time at which the episode began. */
    uint64_t episode_start_nanos;
    /* Length of that tick, nanoseconds. */
    uint64_t period_nanos;
    /* Count of map loads in this epoch, from 1. */
    uint32_t episode;
    /* Records in the payload. */
    uint32_t n_actors;
    /* Revision of world/actors that lists exactly these actors. */
    uint64_t actors_revision;
    /* Bit 0: map or layers changed with this tick. Bit 1: street lights changed. Bit 2: the world went back to a checkpoint before this tick. */
    uint32_t flags;
    /* Zero. */
    uint32_t reserved0;
    /* Random number of the daemon's start. From here on nothing takes part in hashes. */
    uint64_t epoch;
    /* CLOCK_MONOTONIC just before the sample was sent. */
    uint64_t published_mono_nanos;
    /* Zero. */
    uint8_t reserved1[48];
} gantry_snapshot_header;
GANTRY_CHECK(sizeof(gantry_snapshot_header) == 128, "gantry_snapshot_header has another size");
GANTRY_CHECK(offsetof(gantry_snapshot_header, magic) == 0, "gantry_snapshot_header.magic is elsewhere");
GANTRY_CHECK(offsetof(gantry_snapshot_header, schema_version) == 4, "gantry_snapshot_header.schema_version is elsewhere");
GANTRY_CHECK(offsetof(gantry_snapshot_header, header_bytes) == 6, "gantry_snapshot_header.header_bytes is elsewhere");
GANTRY_CHECK(offsetof(gantry_snapshot_header, tick) == 8, "gantry_snapshot_header.tick is elsewhere");
GANTRY_CHECK(offsetof(gantry_snapshot_header, sim_nanos) == 16, "gantry_snapshot_header.sim_nanos is elsewhere");
GANTRY_CHECK(offsetof(gantry_snapshot_header, episode_start_nanos) == 24, "gantry_snapshot_header.episode_start_nanos is elsewhere");
GANTRY_CHECK(offsetof(gantry_snapshot_header, period_nanos) == 32, "gantry_snapshot_header.period_nanos is elsewhere");
GANTRY_CHECK(offsetof(gantry_snapshot_header, episode) == 40, "gantry_snapshot_header.episode is elsewhere");
GANTRY_CHECK(offsetof(gantry_snapshot_header, n_actors) == 44, "gantry_snapshot_header.n_actors is elsewhere");
GANTRY_CHECK(offsetof(gantry_snapshot_header, actors_revision) == 48, "gantry_snapshot_header.actors_revision is elsewhere");
GANTRY_CHECK(offsetof(gantry_snapshot_header, flags) == 56, "gantry_snapshot_header.flags is elsewhere");
GANTRY_CHECK(offsetof(gantry_snapshot_header, reserved0) == 60, "gantry_snapshot_header.reserved0 is elsewhere");
GANTRY_CHECK(offsetof(gantry_snapshot_header, epoch) == 64, "gantry_snapshot_header.epoch is elsewhere");
GANTRY_CHECK(offsetof(gantry_snapshot_header, published_mono_nanos) == 72, "gantry_snapshot_header.published_mono_nanos is elsewhere");
GANTRY_CHECK(offsetof(gantry_snapshot_header, reserved1) == 80, "gantry_snapshot_header.reserved1 is elsewhere");

typedef struct gantry_actor_record {
    /* Actor id. */
    uint32_t id;
    /* Actor it is attached to; 0 if none. */
    uint32_t parent_id;
    /* Index into world/catalogue. */
    uint32_t catalogue_idx;
    /* ActorKind number. */
    uint16_t kind;
    /* Semantic class. */
    uint8_t class_;
    /* Zero. */
    uint8_t reserved;
    /* Pose of the actor's origin in the world. Vehicles: on the ground between the axles. Walkers: middle of the body. */
    gantry_pose world_from_actor;
    /* Velocity of the origin, m/s. */
    double velocity_in_world_mps[3];
    /* Angular velocity, rad/s. */
    double angular_velocity_in_world_radps[3];
    /* Finite difference of the velocity over the tick, m/s². */
    double acceleration_in_world_mps2[3];
    /* Half extents of the body box, metres; its centre is in world/actors. */
    float half_box_m[3];
    /* ActorRecord::PHYSICS and the other flag bits. */
    uint32_t flags;
    /* VehiclePart, TrafficLightPart, TrafficSignPart or WalkerPart by kind; zero otherwise. */
    uint8_t part[96];
} gantry_actor_record;
GANTRY_CHECK(sizeof(gantry_actor_record) == 256, "gantry_actor_record has another size");
GANTRY_CHECK(offsetof(gantry_actor_record, id) == 0, "gantry_actor_record.id is elsewhere");
GANTRY_CHECK(offsetof(gantry_actor_record, parent_id) == 4, "gantry_actor_record.parent_id is elsewhere");
GANTRY_CHECK(offsetof(gantry_actor_record, catalogue_idx) == 8, "gantry_actor_record.catalogue_idx is elsewhere");
GANTRY_CHECK(offsetof(gantry_actor_record, kind) == 12, "gantry_actor_record.kind is elsewhere");
GANTRY_CHECK(offsetof(gantry_actor_record, class_) == 14, "gantry_actor_record.class_ is elsewhere");
GANTRY_CHECK(offsetof(gantry_actor_record, reserved) == 15, "gantry_actor_record.reserved is elsewhere");
GANTRY_CHECK(offsetof(gantry_actor_record, world_from_actor) == 16, "gantry_actor_record.world_from_actor is elsewhere");
GANTRY_CHECK(offsetof(gantry_actor_record, velocity_in_world_mps) == 72, "gantry_actor_record.velocity_in_world_mps is elsewhere");
GANTRY_CHECK(offsetof(gantry_actor_record, angular_velocity_in_world_radps) == 96, "gantry_actor_record.angular_velocity_in_world_radps is elsewhere");
GANTRY_CHECK(offsetof(gantry_actor_record, acceleration_in_world_mps2) == 120, "gantry_actor_record.acceleration_in_world_mps2 is elsewhere");
GANTRY_CHECK(offsetof(gantry_actor_record, half_box_m) == 144, "gantry_actor_record.half_box_m is elsewhere");
GANTRY_CHECK(offsetof(gantry_actor_record, flags) == 156, "gantry_actor_record.flags is elsewhere");
GANTRY_CHECK(offsetof(gantry_actor_record, part) == 160, "gantry_actor_record.part is elsewhere");

typedef struct gantry_vehicle_part {
    /* Applied control, see VehicleControl. */
    float throttle_ratio;
    /* Applied control; positive to the left. */
    float steer_ratio;
    /* Applied control. */
    float brake_ratio;
    /* Bit 0 hand brake, 1 reverse, 2 manual gear shift; bit 8: it lies on its side or roof; bits 16–31: four bits per door, front left to rear right, from 0 (shut) to 15 (open). */
    uint32_t control_flags;
    /* Gear engaged: −1 reverse, 0 neutral, 1 and up forward. */
    int32_t gear;
    /* Engine speed, rad/s. */
    float engine_radps;
    /* Speed limit here, m/s; 0 if unknown. */
    float speed_limit_mps;
    /* Lamps: 1 position, 2 low beam, 4 high beam, 8 brake, 16 right blinker, 32 left blinker, 64 reverse, 128 fog, 256 interior, 512 and 1024 special. */
    uint32_t lamps;
    /* Traffic light whose stop box the vehicle is in; 0 if none. */
    uint32_t light_actor_id;
    /* LightState number of that light; green if none. */
    uint32_t light_state;
    /* Angle of the front wheels, radians, positive to the left (mean of both). */
    float wheel_steer_rad;
    /* Wheels touching the ground, one bit each. */
    uint32_t wheels_on_ground;
    /* Roll angle of each wheel, radians (front left, front right, rear left, rear right, …). */
    float wheel_spin_rad[6];
    /* Suspension travel of each wheel from its rest position, metres, positive is compressed. */
    float wheel_travel_m[6];
} gantry_vehicle_part;
GANTRY_CHECK(sizeof(gantry_vehicle_part) == 96, "gantry_vehicle_part has another size");
GANTRY_CHECK(offsetof(gantry_vehicle_part, throttle_ratio) == 0, "gantry_vehicle_part.throttle_ratio is elsewhere");
GANTRY_CHECK(offsetof(gantry_vehicle_part, steer_ratio) == 4, "gantry_vehicle_part.steer_ratio is elsewhere");
GANTRY_CHECK(offsetof(gantry_vehicle_part, brake_ratio) == 8, "gantry_vehicle_part.brake_ratio is elsewhere");
GANTRY_CHECK(offsetof(gantry_vehicle_part, control_flags) == 12, "gantry_vehicle_part.control_flags is elsewhere");
GANTRY_CHECK(offsetof(gantry_vehicle_part, gear) == 16, "gantry_vehicle_part.gear is elsewhere");
GANTRY_CHECK(offsetof(gantry_vehicle_part, engine_radps) == 20, "gantry_vehicle_part.engine_radps is elsewhere");
GANTRY_CHECK(offsetof(gantry_vehicle_part, speed_limit_mps) == 24, "gantry_vehicle_part.speed_limit_mps is elsewhere");
GANTRY_CHECK(offsetof(gantry_vehicle_part, lamps) == 28, "gantry_vehicle_part.lamps is elsewhere");
GANTRY_CHECK(offsetof(gantry_vehicle_part, light_actor_id) == 32, "gantry_vehicle_part.light_actor_id is elsewhere");
GANTRY_CHECK(offsetof(gantry_vehicle_part, light_state) == 36, "gantry_vehicle_part.light_state is elsewhere");
GANTRY_CHECK(offsetof(gantry_vehicle_part, wheel_steer_rad) == 40, "gantry_vehicle_part.wheel_steer_rad is elsewhere");
GANTRY_CHECK(offsetof(gantry_vehicle_part, wheels_on_ground) == 44, "gantry_vehicle_part.wheels_on_ground is elsewhere");
GANTRY_CHECK(offsetof(gantry_vehicle_part, wheel_spin_rad) == 48, "gantry_vehicle_part.wheel_spin_rad is elsewhere");
GANTRY_CHECK(offsetof(gantry_vehicle_part, wheel_travel_m) == 72, "gantry_vehicle_part.wheel_travel_m is elsewhere");

typedef struct gantry_traffic_light_part {
    /* LightState number. */
    uint32_t state;
    /* Bit 0: timers stand still. */
    uint32_t flags;
    /* Seconds in the current state. */
    float elapsed_secs;
    /* Length of the green stage, seconds. */
    float green_secs;
    /* Length of the yellow stage, seconds. */
    float yellow_secs;
    /* Length of the all-red stage after it, seconds. */
    float red_secs;
    /* Group (junction) the light belongs to, from 1. */
    uint32_t group;
    /* Index within its group. */
    uint32_t pole_idx;
    /* OpenDRIVE signal id, UTF-8, padded with zeros. */
    uint8_t opendrive_id[32];
    /* Zero. */
    uint8_t reserved[32];
} gantry_traffic_light_part;
GANTRY_CHECK(sizeof(gantry_traffic_light_part) == 96, "gantry_traffic_light_part has another size");
GANTRY_CHECK(offsetof(gantry_traffic_light_part, state) == 0, "gantry_traffic_light_part.state is elsewhere");
GANTRY_CHECK(offsetof(gantry_traffic_light_part, flags) == 4, "gantry_traffic_light_part.flags is elsewhere");
GANTRY_CHECK(offsetof(gantry_traffic_light_part, elapsed_secs) == 8, "gantry_traffic_light_part.elapsed_secs is elsewhere");
GANTRY_CHECK(offsetof(gantry_traffic_light_part, green_secs) == 12, "gantry_traffic_light_part.green_secs is elsewhere");
GANTRY_CHECK(offsetof(gantry_traffic_light_part, yellow_secs) == 16, "gantry_traffic_light_part.yellow_secs is elsewhere");
GANTRY_CHECK(offsetof(gantry_traffic_light_part, red_secs) == 20, "gantry_traffic_light_part.red_secs is elsewhere");
GANTRY_CHECK(offsetof(gantry_traffic_light_part, group) == 24, "gantry_traffic_light_part.group is elsewhere");
GANTRY_CHECK(offsetof(gantry_traffic_light_part, pole_idx) == 28, "gantry_traffic_light_part.pole_idx is elsewhere");
GANTRY_CHECK(offsetof(gantry_traffic_light_part, opendrive_id) == 32, "gantry_traffic_light_part.opendrive_id is elsewhere");
GANTRY_CHECK(offsetof(gantry_traffic_light_part, reserved) == 64, "gantry_traffic_light_part.reserved is elsewhere");

typedef struct gantry_traffic_sign_part {
    /* OpenDRIVE signal id, UTF-8, padded with zeros. */
    uint8_t opendrive_id[32];
    /* Zero. */
    uint8_t reserved[64];
} gantry_traffic_sign_part;
GANTRY_CHECK(sizeof(gantry_traffic_sign_part) == 96, "gantry_traffic_sign_part has another size");
GANTRY_CHECK(offsetof(gantry_traffic_sign_part, opendrive_id) == 0, "gantry_traffic_sign_part.opendrive_id is elsewhere");
GANTRY_CHECK(offsetof(gantry_traffic_sign_part, reserved) == 32, "gantry_traffic_sign_part.reserved is elsewhere");

typedef struct gantry_walker_part {
    /* Direction of its control, world. */
    float direction[3];
    /* Speed of its control, m/s. */
    float speed_mps;
    /* Phase of the gait, radians. */
    float gait_rad;
    /* WalkerPart::JUMP and the other flag bits. */
    uint32_t flags;
    /* Walking speed that the motion of the limbs shows, m/s. */
    float gait_mps;
    /* Zero. */
    uint8_t reserved[68];
} gantry_walker_part;
GANTRY_CHECK(sizeof(gantry_walker_part) == 96, "gantry_walker_part has another size");
GANTRY_CHECK(offsetof(gantry_walker_part, direction) == 0, "gantry_walker_part.direction is elsewhere");
GANTRY_CHECK(offsetof(gantry_walker_part, speed_mps) == 12, "gantry_walker_part.speed_mps is elsewhere");
GANTRY_CHECK(offsetof(gantry_walker_part, gait_rad) == 16, "gantry_walker_part.gait_rad is elsewhere");
GANTRY_CHECK(offsetof(gantry_walker_part, flags) == 20, "gantry_walker_part.flags is elsewhere");
GANTRY_CHECK(offsetof(gantry_walker_part, gait_mps) == 24, "gantry_walker_part.gait_mps is elsewhere");
GANTRY_CHECK(offsetof(gantry_walker_part, reserved) == 28, "gantry_walker_part.reserved is elsewhere");

typedef struct gantry_vehicle_control_record {
    /* Actor id of the vehicle. */
    uint32_t actor_id;
    /* See VehicleControl::throttle_ratio. */
    float throttle_ratio;
    /* See VehicleControl::steer_ratio. */
    float steer_ratio;
    /* See VehicleControl::brake_ratio. */
    float brake_ratio;
    /* Bit 0 hand brake, 1 reverse, 2 manual gear shift. */
    uint32_t flags;
    /* See VehicleControl::gear. */
    int32_t gear;
    /* Lamp bits to set (VehiclePart::lamps), or u32::MAX to leave them alone. */
    uint32_t lamps;
    /* Zero. */
    uint32_t reserved;
} gantry_vehicle_control_record;
GANTRY_CHECK(sizeof(gantry_vehicle_control_record) == 32, "gantry_vehicle_control_record has another size");
GANTRY_CHECK(offsetof(gantry_vehicle_control_record, actor_id) == 0, "gantry_vehicle_control_record.actor_id is elsewhere");
GANTRY_CHECK(offsetof(gantry_vehicle_control_record, throttle_ratio) == 4, "gantry_vehicle_control_record.throttle_ratio is elsewhere");
GANTRY_CHECK(offsetof(gantry_vehicle_control_record, steer_ratio) == 8, "gantry_vehicle_control_record.steer_ratio is elsewhere");
GANTRY_CHECK(offsetof(gantry_vehicle_control_record, brake_ratio) == 12, "gantry_vehicle_control_record.brake_ratio is elsewhere");
GANTRY_CHECK(offsetof(gantry_vehicle_control_record, flags) == 16, "gantry_vehicle_control_record.flags is elsewhere");
GANTRY_CHECK(offsetof(gantry_vehicle_control_record, gear) == 20, "gantry_vehicle_control_record.gear is elsewhere");
GANTRY_CHECK(offsetof(gantry_vehicle_control_record, lamps) == 24, "gantry_vehicle_control_record.lamps is elsewhere");
GANTRY_CHECK(offsetof(gantry_vehicle_control_record, reserved) == 28, "gantry_vehicle_control_record.reserved is elsewhere");

typedef struct gantry_result_header {
    /* RESULT_MAGIC. */
    GANTRY_ALIGNED(64) uint32_t magic;
    /* SCHEMA_VERSION. */
    uint16_t schema_version;
    /* 320. */
    uint16_t header_bytes;
    /* ResultType number. */
    uint16_t result_type;
    /* PixelFormat number of pixels, ElementType number of a tensor, otherwise 0. */
    uint16_t encoding;
    /* Bit 0 ResultHeader::FIRST, bit 1 ResultHeader::REPLAYED. */
    uint32_t flags;
    /* Tick that the result is about: of its newest input, if the writer says nothing else. */
    uint64_t tick;
    /* Simulated time of that tick, nanoseconds since the daemon started. */
    uint64_t sim_nanos;
    /* Number of the result, counted by its writer from 1; a gap is a loss. */
    uint64_t seq;
    /* Episode of the newest input; 0 if not known. */
    uint32_t episode;
    /* Number of InputRecords behind the body, at most 8. */
    uint32_t n_inputs;
    /* Payload bytes in use: the body, padding to a multiple of 8, the inputs. */
    uint64_t payload_bytes;
    /* Bytes of the body, which begins the payload. */
    uint64_t body_bytes;
    /* Pixels per row; of masks and key points the image's width. */
    uint32_t width;
    /* Rows; of masks and key points the image's height. */
    uint32_t height;
    /* Bytes from one row to the next. */
    uint32_t row_stride;
    /* Bytes of one pixel, element, record or point; 1 of texts and bytes. */
    uint32_t element_bytes;
    /* Records or points; elements of a tensor; bytes of a text. */
    uint32_t n_items;
    /* Dimensions of a tensor, at most 8; otherwise 0. */
    uint32_t n_dims;
    /* Sizes of a tensor's dimensions, slowest first. */
    uint32_t shape[8];
    /* Pose of the result's space in the world: of the sensor for results in image or sensor space. */
    gantry_pose world_from_space;
    /* [fx, fy, cx, cy] of the image that it answers, pixels; 0 where it has no meaning. */
    double intrinsics_px[4];
    /* Space number. */
    uint32_t space;
    /* Zero. */
    uint32_t reserved0;
    /* Epoch of the simulator whose frames it answers; 0 without one. From here on nothing takes part in hashes. */
    uint64_t epoch;
    /* Random number of the writer's start: another one than before means that it was restarted. */
    uint64_t writer_epoch;
    /* CLOCK_MONOTONIC at which the oldest sensor frame behind this result was published, through all results between; 0 without one. */
    uint64_t origin_mono_nanos;
    /* CLOCK_MONOTONIC at which the writer had its first input in hand; 0 without one. */
    uint64_t taken_mono_nanos;
    /* CLOCK_MONOTONIC just before the result was sent. */
    uint64_t published_mono_nanos;
    /* 0: the payload is in this sample. 1: the body is on the GPU, and the sample holds a GpuPlace and the inputs. */
    uint32_t payload_place;
    /* Zero. */
    uint8_t reserved1[60];
} gantry_result_header;
GANTRY_CHECK(sizeof(gantry_result_header) == 320, "gantry_result_header has another size");
GANTRY_CHECK(offsetof(gantry_result_header, magic) == 0, "gantry_result_header.magic is elsewhere");
GANTRY_CHECK(offsetof(gantry_result_header, schema_version) == 4, "gantry_result_header.schema_version is elsewhere");
GANTRY_CHECK(offsetof(gantry_result_header, header_bytes) == 6, "gantry_result_header.header_bytes is elsewhere");
GANTRY_CHECK(offsetof(gantry_result_header, result_type) == 8, "gantry_result_header.result_type is elsewhere");
GANTRY_CHECK(offsetof(gantry_result_header, encoding) == 10, "gantry_result_header.encoding is elsewhere");
GANTRY_CHECK(offsetof(gantry_result_header, flags) == 12, "gantry_result_header.flags is elsewhere");
GANTRY_CHECK(offsetof(gantry_result_header, tick) == 16, "gantry_result_header.tick is elsewhere");
GANTRY_CHECK(offsetof(gantry_result_header, sim_nanos) == 24, "gantry_result_header.sim_nanos is elsewhere");
GANTRY_CHECK(offsetof(gantry_result_header, seq) == 32, "gantry_result_header.seq is elsewhere");
GANTRY_CHECK(offsetof(gantry_result_header, episode) == 40, "gantry_result_header.episode is elsewhere");
GANTRY_CHECK(offsetof(gantry_result_header, n_inputs) == 44, "gantry_result_header.n_inputs is elsewhere");
GANTRY_CHECK(offsetof(gantry_result_header, payload_bytes) == 48, "gantry_result_header.payload_bytes is elsewhere");
GANTRY_CHECK(offsetof(gantry_result_header, body_bytes) == 56, "gantry_result_header.body_bytes is elsewhere");
GANTRY_CHECK(offsetof(gantry_result_header, width) == 64, "gantry_result_header.width is elsewhere");
GANTRY_CHECK(offsetof(gantry_result_header, height) == 68, "gantry_result_header.height is elsewhere");
GANTRY_CHECK(offsetof(gantry_result_header, row_stride) == 72, "gantry_result_header.row_stride is elsewhere");
GANTRY_CHECK(offsetof(gantry_result_header, element_bytes) == 76, "gantry_result_header.element_bytes is elsewhere");
GANTRY_CHECK(offsetof(gantry_result_header, n_items) == 80, "gantry_result_header.n_items is elsewhere");
GANTRY_CHECK(offsetof(gantry_result_header, n_dims) == 84, "gantry_result_header.n_dims is elsewhere");
GANTRY_CHECK(offsetof(gantry_result_header, shape) == 88, "gantry_result_header.shape is elsewhere");
GANTRY_CHECK(offsetof(gantry_result_header, world_from_space) == 120, "gantry_result_header.world_from_space is elsewhere");
GANTRY_CHECK(offsetof(gantry_result_header, intrinsics_px) == 176, "gantry_result_header.intrinsics_px is elsewhere");
GANTRY_CHECK(offsetof(gantry_result_header, space) == 208, "gantry_result_header.space is elsewhere");
GANTRY_CHECK(offsetof(gantry_result_header, reserved0) == 212, "gantry_result_header.reserved0 is elsewhere");
GANTRY_CHECK(offsetof(gantry_result_header, epoch) == 216, "gantry_result_header.epoch is elsewhere");
GANTRY_CHECK(offsetof(gantry_result_header, writer_epoch) == 224, "gantry_result_header.writer_epoch is elsewhere");
GANTRY_CHECK(offsetof(gantry_result_header, origin_mono_nanos) == 232, "gantry_result_header.origin_mono_nanos is elsewhere");
GANTRY_CHECK(offsetof(gantry_result_header, taken_mono_nanos) == 240, "gantry_result_header.taken_mono_nanos is elsewhere");
GANTRY_CHECK(offsetof(gantry_result_header, published_mono_nanos) == 248, "gantry_result_header.published_mono_nanos is elsewhere");
GANTRY_CHECK(offsetof(gantry_result_header, payload_place) == 256, "gantry_result_header.payload_place is elsewhere");
GANTRY_CHECK(offsetof(gantry_result_header, reserved1) == 260, "gantry_result_header.reserved1 is elsewhere");

typedef struct gantry_input_record {
    /* Its topic without the domain, UTF-8, padded with zeros. */
    uint8_t topic[200];
    /* Its tick. */
    uint64_t tick;
    /* Its number. */
    uint64_t seq;
    /* Its simulated time, nanoseconds. */
    uint64_t sim_nanos;
    /* Its epoch; of a result its writer_epoch. */
    uint64_t epoch;
    /* CLOCK_MONOTONIC just before it was sent. */
    uint64_t published_mono_nanos;
    /* CLOCK_MONOTONIC at which the writer of the result had it in hand. */
    uint64_t taken_mono_nanos;
    /* Zero. */
    uint64_t reserved;
} gantry_input_record;
GANTRY_CHECK(sizeof(gantry_input_record) == 256, "gantry_input_record has another size");
GANTRY_CHECK(offsetof(gantry_input_record, topic) == 0, "gantry_input_record.topic is elsewhere");
GANTRY_CHECK(offsetof(gantry_input_record, tick) == 200, "gantry_input_record.tick is elsewhere");
GANTRY_CHECK(offsetof(gantry_input_record, seq) == 208, "gantry_input_record.seq is elsewhere");
GANTRY_CHECK(offsetof(gantry_input_record, sim_nanos) == 216, "gantry_input_record.sim_nanos is elsewhere");
GANTRY_CHECK(offsetof(gantry_input_record, epoch) == 224, "gantry_input_record.epoch is elsewhere");
GANTRY_CHECK(offsetof(gantry_input_record, published_mono_nanos) == 232, "gantry_input_record.published_mono_nanos is elsewhere");
GANTRY_CHECK(offsetof(gantry_input_record, taken_mono_nanos) == 240, "gantry_input_record.taken_mono_nanos is elsewhere");
GANTRY_CHECK(offsetof(gantry_input_record, reserved) == 248, "gantry_input_record.reserved is elsewhere");

typedef struct gantry_box2d {
    /* Corner with the smallest coordinates [x, y], pixels from the outer corner of the top-left pixel. */
    float min_px[2];
    /* Corner with the largest coordinates [x, y], pixels. */
    float max_px[2];
    /* Confidence, 0..=1. */
    float score;
    /* Number in the topic's list of classes, or a CARLA class if it has none. */
    uint32_t class_;
    /* Number of the object that the writer gives; 0 if it gives none. */
    uint32_t id;
    /* Zero. */
    uint32_t reserved;
} gantry_box2d;
GANTRY_CHECK(sizeof(gantry_box2d) == 32, "gantry_box2d has another size");
GANTRY_CHECK(offsetof(gantry_box2d, min_px) == 0, "gantry_box2d.min_px is elsewhere");
GANTRY_CHECK(offsetof(gantry_box2d, max_px) == 8, "gantry_box2d.max_px is elsewhere");
GANTRY_CHECK(offsetof(gantry_box2d, score) == 16, "gantry_box2d.score is elsewhere");
GANTRY_CHECK(offsetof(gantry_box2d, class_) == 20, "gantry_box2d.class_ is elsewhere");
GANTRY_CHECK(offsetof(gantry_box2d, id) == 24, "gantry_box2d.id is elsewhere");
GANTRY_CHECK(offsetof(gantry_box2d, reserved) == 28, "gantry_box2d.reserved is elsewhere");

typedef struct gantry_box3d {
    /* Centre and axes of the box in the result's space; x is the object's forward axis. */
    gantry_pose pose;
    /* Half of the box's length, width and height along its own axes, metres. */
    float half_m[3];
    /* Velocity in the result's space, m/s; NaN if it was not estimated. */
    float velocity_mps[3];
    /* Confidence, 0..=1. */
    float score;
    /* Number in the topic's list of classes, or a CARLA class if it has none. */
    uint32_t class_;
    /* Number of the object that the writer gives; 0 if it gives none. */
    uint32_t id;
    /* Points of the cloud inside the box; 0 if not counted. */
    uint32_t n_points;
    /* Zero. */
    uint32_t reserved[2];
} gantry_box3d;
GANTRY_CHECK(sizeof(gantry_box3d) == 104, "gantry_box3d has another size");
GANTRY_CHECK(offsetof(gantry_box3d, pose) == 0, "gantry_box3d.pose is elsewhere");
GANTRY_CHECK(offsetof(gantry_box3d, half_m) == 56, "gantry_box3d.half_m is elsewhere");
GANTRY_CHECK(offsetof(gantry_box3d, velocity_mps) == 68, "gantry_box3d.velocity_mps is elsewhere");
GANTRY_CHECK(offsetof(gantry_box3d, score) == 80, "gantry_box3d.score is elsewhere");
GANTRY_CHECK(offsetof(gantry_box3d, class_) == 84, "gantry_box3d.class_ is elsewhere");
GANTRY_CHECK(offsetof(gantry_box3d, id) == 88, "gantry_box3d.id is elsewhere");
GANTRY_CHECK(offsetof(gantry_box3d, n_points) == 92, "gantry_box3d.n_points is elsewhere");
GANTRY_CHECK(offsetof(gantry_box3d, reserved) == 96, "gantry_box3d.reserved is elsewhere");

typedef struct gantry_track {
    /* Number of the track, from 1, the same for as long as it lives. */
    uint32_t id;
    /* Number in the topic's list of classes, or a CARLA class if it has none. */
    uint32_t class_;
    /* 0 tentative, 1 confirmed, 2 lost and predicted, 3 ended with this result. */
    uint32_t state;
    /* Bit 0: the box in the image holds; bit 1: the box in space holds. */
    uint32_t flags;
    /* Confidence, 0..=1. */
    float score;
    /* Results in which it was seen. */
    uint32_t n_hits;
    /* Results since it was seen last; 0 if this one saw it. */
    uint32_t n_missed;
    /* Time since it began, simulated seconds. */
    float age_secs;
    /* Box in the image as in Box2d, pixels. */
    float min_px[2];
    /* Box in the image as in Box2d, pixels. */
    float max_px[2];
    /* Velocity of the box's centre in the image, pixels per second. */
    float velocity_pxps[2];
    /* Zero. */
    uint32_t reserved0[2];
    /* Box in space as in Box3d. */
    gantry_pose pose;
    /* Half of the box's length, width and height, metres. */
    float half_m[3];
    /* Velocity in the result's space, m/s. */
    float velocity_mps[3];
    /* Rate of turn about the result's z axis, rad/s. */
    float yaw_rate_radps;
    /* Zero. */
    uint32_t reserved1;
} gantry_track;
GANTRY_CHECK(sizeof(gantry_track) == 152, "gantry_track has another size");
GANTRY_CHECK(offsetof(gantry_track, id) == 0, "gantry_track.id is elsewhere");
GANTRY_CHECK(offsetof(gantry_track, class_) == 4, "gantry_track.class_ is elsewhere");
GANTRY_CHECK(offsetof(gantry_track, state) == 8, "gantry_track.state is elsewhere");
GANTRY_CHECK(offsetof(gantry_track, flags) == 12, "gantry_track.flags is elsewhere");
GANTRY_CHECK(offsetof(gantry_track, score) == 16, "gantry_track.score is elsewhere");
GANTRY_CHECK(offsetof(gantry_track, n_hits) == 20, "gantry_track.n_hits is elsewhere");
GANTRY_CHECK(offsetof(gantry_track, n_missed) == 24, "gantry_track.n_missed is elsewhere");
GANTRY_CHECK(offsetof(gantry_track, age_secs) == 28, "gantry_track.age_secs is elsewhere");
GANTRY_CHECK(offsetof(gantry_track, min_px) == 32, "gantry_track.min_px is elsewhere");
GANTRY_CHECK(offsetof(gantry_track, max_px) == 40, "gantry_track.max_px is elsewhere");
GANTRY_CHECK(offsetof(gantry_track, velocity_pxps) == 48, "gantry_track.velocity_pxps is elsewhere");
GANTRY_CHECK(offsetof(gantry_track, reserved0) == 56, "gantry_track.reserved0 is elsewhere");
GANTRY_CHECK(offsetof(gantry_track, pose) == 64, "gantry_track.pose is elsewhere");
GANTRY_CHECK(offsetof(gantry_track, half_m) == 120, "gantry_track.half_m is elsewhere");
GANTRY_CHECK(offsetof(gantry_track, velocity_mps) == 132, "gantry_track.velocity_mps is elsewhere");
GANTRY_CHECK(offsetof(gantry_track, yaw_rate_radps) == 144, "gantry_track.yaw_rate_radps is elsewhere");
GANTRY_CHECK(offsetof(gantry_track, reserved1) == 148, "gantry_track.reserved1 is elsewhere");

typedef struct gantry_mask_record {
    /* Box round the mask as in Box2d, pixels. */
    float min_px[2];
    /* Box round the mask as in Box2d, pixels. */
    float max_px[2];
    /* Confidence, 0..=1. */
    float score;
    /* Number in the topic's list of classes, or a CARLA class if it has none. */
    uint32_t class_;
    /* Number of the object that the writer gives; 0 if it gives none. */
    uint32_t id;
    /* Index of its first run in the list of all runs. */
    uint32_t first_run;
    /* Number of its runs. */
    uint32_t n_runs;
    /* Zero. */
    uint32_t reserved[3];
} gantry_mask_record;
GANTRY_CHECK(sizeof(gantry_mask_record) == 48, "gantry_mask_record has another size");
GANTRY_CHECK(offsetof(gantry_mask_record, min_px) == 0, "gantry_mask_record.min_px is elsewhere");
GANTRY_CHECK(offsetof(gantry_mask_record, max_px) == 8, "gantry_mask_record.max_px is elsewhere");
GANTRY_CHECK(offsetof(gantry_mask_record, score) == 16, "gantry_mask_record.score is elsewhere");
GANTRY_CHECK(offsetof(gantry_mask_record, class_) == 20, "gantry_mask_record.class_ is elsewhere");
GANTRY_CHECK(offsetof(gantry_mask_record, id) == 24, "gantry_mask_record.id is elsewhere");
GANTRY_CHECK(offsetof(gantry_mask_record, first_run) == 28, "gantry_mask_record.first_run is elsewhere");
GANTRY_CHECK(offsetof(gantry_mask_record, n_runs) == 32, "gantry_mask_record.n_runs is elsewhere");
GANTRY_CHECK(offsetof(gantry_mask_record, reserved) == 36, "gantry_mask_record.reserved is elsewhere");

typedef struct gantry_keypoint_set {
    /* Confidence, 0..=1. */
    float score;
    /* Number in the topic's list of classes, or a CARLA class if it has none. */
    uint32_t class_;
    /* Number of the object that the writer gives; 0 if it gives none. */
    uint32_t id;
    /* Index of its first point in the list of all points. */
    uint32_t first_point;
    /* Number of its points. */
    uint32_t n_points;
    /* Zero. */
    uint32_t reserved[3];
} gantry_keypoint_set;
GANTRY_CHECK(sizeof(gantry_keypoint_set) == 32, "gantry_keypoint_set has another size");
GANTRY_CHECK(offsetof(gantry_keypoint_set, score) == 0, "gantry_keypoint_set.score is elsewhere");
GANTRY_CHECK(offsetof(gantry_keypoint_set, class_) == 4, "gantry_keypoint_set.class_ is elsewhere");
GANTRY_CHECK(offsetof(gantry_keypoint_set, id) == 8, "gantry_keypoint_set.id is elsewhere");
GANTRY_CHECK(offsetof(gantry_keypoint_set, first_point) == 12, "gantry_keypoint_set.first_point is elsewhere");
GANTRY_CHECK(offsetof(gantry_keypoint_set, n_points) == 16, "gantry_keypoint_set.n_points is elsewhere");
GANTRY_CHECK(offsetof(gantry_keypoint_set, reserved) == 20, "gantry_keypoint_set.reserved is elsewhere");

typedef struct gantry_keypoint {
    /* Place [x, y], pixels. */
    float at_px[2];
    /* Confidence, 0..=1. */
    float score;
    /* 0 not labelled, 1 hidden, 2 visible, as COCO counts. */
    uint32_t visibility;
} gantry_keypoint;
GANTRY_CHECK(sizeof(gantry_keypoint) == 16, "gantry_keypoint has another size");
GANTRY_CHECK(offsetof(gantry_keypoint, at_px) == 0, "gantry_keypoint.at_px is elsewhere");
GANTRY_CHECK(offsetof(gantry_keypoint, score) == 8, "gantry_keypoint.score is elsewhere");
GANTRY_CHECK(offsetof(gantry_keypoint, visibility) == 12, "gantry_keypoint.visibility is elsewhere");

typedef struct gantry_pose_estimate {
    /* The pose in the result's space. */
    gantry_pose pose;
    /* Covariance of x, y, z and of the rotations about x, y, z, row after row, m² and rad²; all zero if not known. */
    double covariance[36];
} gantry_pose_estimate;
GANTRY_CHECK(sizeof(gantry_pose_estimate) == 344, "gantry_pose_estimate has another size");
GANTRY_CHECK(offsetof(gantry_pose_estimate, pose) == 0, "gantry_pose_estimate.pose is elsewhere");
GANTRY_CHECK(offsetof(gantry_pose_estimate, covariance) == 56, "gantry_pose_estimate.covariance is elsewhere");

typedef struct gantry_odometry {
    /* The pose in the result's space. */
    gantry_pose pose;
    /* Covariance as in PoseEstimate. */
    double pose_covariance[36];
    /* Velocity along the body's own axes, m/s. */
    double velocity_mps[3];
    /* Rates of turn about the body's own axes, rad/s. */
    double angular_velocity_radps[3];
    /* Covariance of velocity and rates of turn, row after row; all zero if not known. */
    double twist_covariance[36];
} gantry_odometry;
GANTRY_CHECK(sizeof(gantry_odometry) == 680, "gantry_odometry has another size");
GANTRY_CHECK(offsetof(gantry_odometry, pose) == 0, "gantry_odometry.pose is elsewhere");
GANTRY_CHECK(offsetof(gantry_odometry, pose_covariance) == 56, "gantry_odometry.pose_covariance is elsewhere");
GANTRY_CHECK(offsetof(gantry_odometry, velocity_mps) == 344, "gantry_odometry.velocity_mps is elsewhere");
GANTRY_CHECK(offsetof(gantry_odometry, angular_velocity_radps) == 368, "gantry_odometry.angular_velocity_radps is elsewhere");
GANTRY_CHECK(offsetof(gantry_odometry, twist_covariance) == 392, "gantry_odometry.twist_covariance is elsewhere");

typedef struct gantry_path_point {
    /* Place and heading in the result's space. */
    gantry_pose pose;
    /* Time from the result's sim_nanos to the moment at this point, simulated seconds; NaN if the path has no times. */
    float after_secs;
    /* Speed along the path, m/s; NaN if not planned. */
    float speed_mps;
    /* Acceleration along the path, m/s²; NaN if not planned. */
    float acceleration_mps2;
    /* Curvature, 1/m, positive to the left; NaN if not planned. */
    float curvature_pm;
    /* Zero. */
    uint32_t reserved[2];
} gantry_path_point;
GANTRY_CHECK(sizeof(gantry_path_point) == 80, "gantry_path_point has another size");
GANTRY_CHECK(offsetof(gantry_path_point, pose) == 0, "gantry_path_point.pose is elsewhere");
GANTRY_CHECK(offsetof(gantry_path_point, after_secs) == 56, "gantry_path_point.after_secs is elsewhere");
GANTRY_CHECK(offsetof(gantry_path_point, speed_mps) == 60, "gantry_path_point.speed_mps is elsewhere");
GANTRY_CHECK(offsetof(gantry_path_point, acceleration_mps2) == 64, "gantry_path_point.acceleration_mps2 is elsewhere");
GANTRY_CHECK(offsetof(gantry_path_point, curvature_pm) == 68, "gantry_path_point.curvature_pm is elsewhere");
GANTRY_CHECK(offsetof(gantry_path_point, reserved) == 72, "gantry_path_point.reserved is elsewhere");

typedef struct gantry_scalar {
    /* Its value. */
    double value;
    /* Its name, UTF-8, padded with zeros; a unit belongs into the name (speed_mps). */
    uint8_t name[56];
} gantry_scalar;
GANTRY_CHECK(sizeof(gantry_scalar) == 64, "gantry_scalar has another size");
GANTRY_CHECK(offsetof(gantry_scalar, value) == 0, "gantry_scalar.value is elsewhere");
GANTRY_CHECK(offsetof(gantry_scalar, name) == 8, "gantry_scalar.name is elsewhere");

#endif
