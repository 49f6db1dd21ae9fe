/* Gantry for programs in C: sensors' frames in shared memory, results, lockstep, the world and its control.
 *
 * Every function here follows the same rules.
 *
 * Errors. A call returns a gantry_status: GANTRY_OK is 0, GANTRY_NOTHING says that the time was over, and less than 0 is an error whose
 * sentence gantry_last_error() has. After an error nothing was handed over, and the handles that were given are as they were.
 * Functions that return a pointer or a number return NULL or 0 for a handle that is NULL; they cannot fail otherwise.
 * Ownership. A handle that a call hands over belongs to the caller, who ends it with the function that its comment names; ending NULL does
 * nothing. Handles keep what they need: a bus may be closed before its readers, a reader before its samples. Pointers into a sample, a loan
 * or a world are valid until that is ended. End all handles before the process ends, so that others see it leave at once.
 * Texts are UTF-8 and end with a zero. Those that are handed out belong to the library; each comment says until when they are valid.
 * Threads. A gantry_bus may be used by any number of threads at once. Every other handle may be passed from thread to thread, but be used by
 * one at a time. gantry_last_error() is per thread. A child after fork() must not use, nor end, what its parent made: start it by exec.
 * Time. Timeouts are nanoseconds from the call on: 0 looks once, less than 0 (GANTRY_FOREVER) has no limit, GANTRY_PATIENCE is the usual
 * one. A call that waits is not ended by a signal: give it a limit and look at your own flag. Moments named mono_nanos are CLOCK_MONOTONIC.
 * Units are SI and radians, x forward, y left, z up. layout.h has the structs in shared memory; docs and SPEC.md their meaning.
 *
 * Stability. GANTRY_ABI_VERSION is raised when a function or a struct changes, and GANTRY_SCHEMA_VERSION when a layout of shared memory does;
 * gantry_bus_open compares both with the library's. Structs of this file begin with their own size.
 */
#ifndef GANTRY_GANTRY_H
#define GANTRY_GANTRY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "gantry/layout.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Version of the functions and structs of this file. */
#define GANTRY_ABI_VERSION 1u

/* Waits without a limit. */
#define GANTRY_FOREVER ((int64_t)-1)
/* The usual patience, 10 s: a program that is started a few seconds before the simulator works. */
#define GANTRY_PATIENCE ((int64_t)10000000000)

/* What a call returns. */
typedef enum gantry_status {
    GANTRY_OK = 0,
    /* The time was over, and there was nothing. No error. */
    GANTRY_NOTHING = 1,
    /* Anything that has no number of its own; the sentence says what. */
    GANTRY_FAILED = -1,
    /* An argument is wrong: NULL where something must be, no UTF-8, an unknown name. */
    GANTRY_ARGUMENT = -2,
    /* The topic, or the simulator that answers, is not there. */
    GANTRY_NO_SUCH_TOPIC = -3,
    /* The other side, or this program's header, is of another version. */
    GANTRY_SCHEMA = -4,
    /* The topic has as many readers as it allows. */
    GANTRY_TOO_MANY_READERS = -5,
    /* Another process writes this topic of results. */
    GANTRY_TOPIC_TAKEN = -6,
    /* Too many samples or loans of this port are held; end one. */
    GANTRY_BORROW_LIMIT = -7,
    /* A sample broke the contract and was dropped; the next call goes on after it. */
    GANTRY_BAD_SAMPLE = -8,
    /* The simulator refused. */
    GANTRY_REFUSED = -9,
    /* A bug of the library, which was caught. */
    GANTRY_BUG = -10
} gantry_status;

/* A domain that this process has joined. */
typedef struct gantry_bus gantry_bus;
/* The reading end of a topic of frames or of results. */
typedef struct gantry_reader gantry_reader;
/* A frame or a result in shared memory. A reader may hold three at a time (of small topics four), so end it soon. */
typedef struct gantry_sample gantry_sample;
/* The writing end of a topic of results. */
typedef struct gantry_publisher gantry_publisher;
/* A slot of shared memory for one result. */
typedef struct gantry_loan gantry_loan;
/* The last 32 snapshots of the world. */
typedef struct gantry_snapshots gantry_snapshots;
/* One snapshot, copied out of shared memory: all actors after a tick. */
typedef struct gantry_world gantry_world;
/* A place in lockstep. */
typedef struct gantry_lockstep gantry_lockstep;
/* A writer of vehicle controls. */
typedef struct gantry_controls gantry_controls;

/* --- the library -------------------------------------------------------------------------------------------------------------------- */

/* The sentence of this thread's last error: what failed, with which value, and what to do. Empty before the first. Valid until this
 * thread's next error. */
const char *gantry_last_error(void);

/* Version of the library, for example "0.1.0". Valid for ever. */
const char *gantry_version(void);

/* The library's GANTRY_ABI_VERSION. */
uint32_t gantry_abi_version(void);

/* The domain of a program that is told no other: GANTRY_DOMAIN of the environment, else "gantry". Valid until this thread's next call
 * that hands out a text. */
const char *gantry_default_domain(void);

/* --- a domain ----------------------------------------------------------------------------------------------------------------------- */

/* What gantry_bus_open calls, with the versions of this header. */
gantry_status gantry_bus_open_versions(uint32_t abi_version, uint32_t schema_version, const char *domain, const char *program,
                                       gantry_bus **bus);

/* Joins `domain` (NULL: the default one) as `program`, the name in lists and messages. The simulator need not run yet.
 * GANTRY_SCHEMA if this header is not the library's. Ended by gantry_bus_close. */
static inline gantry_status gantry_bus_open(const char *domain, const char *program, gantry_bus **bus) {
    return gantry_bus_open_versions(GANTRY_ABI_VERSION, GANTRY_SCHEMA_VERSION, domain, program, bus);
}

/* Leaves the domain, with the last handle that was opened on it. */
void gantry_bus_close(gantry_bus *bus);

/* Sends a JSON list of commands, for example [{"do":"step","n":1}], and waits for the simulator's answer; SPEC.md, section 7, has both.
 * `answer` (may be NULL) gets the answer's JSON, also of a refusal. It is valid until this thread's next call that hands out a text.
 * GANTRY_REFUSED with the sentence of the first command that was refused; those before and after it were done. GANTRY_NO_SUCH_TOPIC if no
 * simulator came in time, GANTRY_FAILED if it did not answer. */
gantry_status gantry_command(gantry_bus *bus, const char *commands, int64_t timeout_nanos, const char **answer);

/* Waits for a document: world/info, world/map, world/actors, world/catalogue, world/spawn_points, or TOPIC/about of results. `text` is
 * valid until this thread's next call that hands out a text. GANTRY_NO_SUCH_TOPIC if nobody publishes it in time. */
gantry_status gantry_document(gantry_bus *bus, const char *name, int64_t timeout_nanos, const char **text);

/* --- reading ------------------------------------------------------------------------------------------------------------------------ */

/* Which sample to take if several wait. */
typedef enum gantry_which {
    /* Every one in order, for recorders and in lockstep. */
    GANTRY_OLDEST = 0,
    /* The newest; older ones are dropped and counted as skipped. */
    GANTRY_NEWEST = 1
} gantry_which;

/* What a reader has counted. Set struct_bytes to sizeof(gantry_counts) before the call. */
typedef struct gantry_counts {
    uint32_t struct_bytes;
    uint32_t reserved;
    /* Samples taken. */
    uint64_t taken;
    /* Samples passed over by GANTRY_NEWEST. */
    uint64_t skipped;
    /* Samples that were never seen: gaps in their numbers, because this reader was too slow. */
    uint64_t lost;
    /* Samples that broke the contract. */
    uint64_t refused;
    /* Starts of another writer. */
    uint64_t restarts;
} gantry_counts;

/* Opens `topic` without the domain ("ego/front/rgb"), and waits until it is there. Frames of a sensor begin with its first reader.
 * GANTRY_NO_SUCH_TOPIC after `timeout_nanos`, with the topics that exist. Ended by gantry_reader_close. */
gantry_status gantry_reader_open(gantry_bus *bus, const char *topic, int64_t timeout_nanos, gantry_reader **reader);
void gantry_reader_close(gantry_reader *reader);

/* Takes a sample, and waits for it if there is none. GANTRY_NOTHING after `timeout_nanos`; `*sample` is then NULL. The writer may end and
 * come back meanwhile. GANTRY_BORROW_LIMIT, GANTRY_BAD_SAMPLE. Ended by gantry_sample_release. */
gantry_status gantry_reader_take(gantry_reader *reader, gantry_which which, int64_t timeout_nanos, gantry_sample **sample);

/* Fills in `counts`, since the reader was opened. */
gantry_status gantry_reader_counts(const gantry_reader *reader, gantry_counts *counts);

/* Whether a process writes the topic now. */
bool gantry_reader_has_writer(const gantry_reader *reader);

/* A descriptor for poll and epoll, readable when a sample may wait; gantry_reader_take with GANTRY_OLDEST until GANTRY_NOTHING makes it
 * unreadable again. It belongs to the reader: do not read or close it. -1 for NULL. */
int gantry_reader_fd(const gantry_reader *reader);

/* Type of the topic's results ("boxes2d"); NULL for frames. Valid as long as the reader. */
const char *gantry_reader_result_type(const gantry_reader *reader);

/* Gives the sample's memory back to its writer. */
void gantry_sample_release(gantry_sample *sample);

/* Header of a frame, checked; NULL for a result. */
const gantry_frame_header *gantry_sample_frame(const gantry_sample *sample);

/* Header of a result, checked; NULL for a frame. */
const gantry_result_header *gantry_sample_result(const gantry_sample *sample);

/* The payload of a frame, or the body of a result, where it lies in shared memory: read-only, 64-aligned, `*len_bytes` (may be NULL) long.
 * Row y of an image begins at y * row_stride. */
const uint8_t *gantry_sample_bytes(const gantry_sample *sample, size_t *len_bytes);

/* The `*len` (may be NULL) frames and results that a result answers; 0 of a frame. */
const gantry_input_record *gantry_sample_inputs(const gantry_sample *sample, size_t *len);

/* Topic without the domain. */
const char *gantry_sample_topic(const gantry_sample *sample);

/* When this reader took it. */
uint64_t gantry_sample_taken_mono_nanos(const gantry_sample *sample);

/* --- publishing --------------------------------------------------------------------------------------------------------------------- */

/* Opens `topic` ("my_detector/boxes") as its only writer. `result_type` is one of boxes2d, boxes3d, tracks, masks, image, tensor,
 * keypoints, flow, depth, semantic, instance, points, pose, odometry, path, control, scalars, text, json, bytes. `about` is the description
 * as JSON ({"classes": ["car", "person"]}), or NULL for CARLA's classes. GANTRY_TOPIC_TAKEN. Ended by gantry_publisher_close. */
gantry_status gantry_publisher_open(gantry_bus *bus, const char *topic, const char *result_type, const char *about,
                                    gantry_publisher **publisher);
void gantry_publisher_close(gantry_publisher *publisher);

/* Number of readers now. */
size_t gantry_publisher_readers(const gantry_publisher *publisher);

/* Loans room for a body of up to `body_bytes`. It holds the bytes of an earlier result: write all of what is sent, and zero into reserved
 * fields. GANTRY_BORROW_LIMIT if all loans are open. Ended by gantry_loan_send or gantry_loan_drop. */
gantry_status gantry_publisher_loan(gantry_publisher *publisher, size_t body_bytes, gantry_loan **loan);

/* The room for the body, where it lies in shared memory: 64-aligned, `*room_bytes` (may be NULL) long. */
uint8_t *gantry_loan_body(gantry_loan *loan, size_t *room_bytes);

/* The header, for space, pose and whatever the inputs do not say. Numbers, sizes and clocks are set by gantry_loan_send. */
gantry_result_header *gantry_loan_header(gantry_loan *loan);

/* Says what the body is: `n_items` records of `element_bytes` each, and behind them `tail_bytes` of a mask's runs or key points. Texts and
 * bytes are lists of single bytes. GANTRY_FAILED if the loan has less room. */
gantry_status gantry_loan_set_list(gantry_loan *loan, uint32_t n_items, uint32_t element_bytes, uint64_t tail_bytes);

/* The body is an image with tight rows in one of bgra8, bgr8, rgb8, rgba8, mono8, mono16, mono32f, depth, class, id, flow, normals. */
gantry_status gantry_loan_set_image(gantry_loan *loan, uint32_t width_px, uint32_t height_px, const char *pixel_format);

/* The body is a tensor of `n_dims` (at most 8) `sizes`, slowest first, of u8, i8, u16, i16, u32, i32, u64, i64, f16, f32, f64 or bool. */
gantry_status gantry_loan_set_tensor(gantry_loan *loan, const char *element_type, const uint32_t *sizes, size_t n_dims);

/* Names a frame or a result that this one was computed from, at most 8. It takes over the input's tick and times and, in image or sensor
 * space, pose and intrinsics; latency is measured by it. */
gantry_status gantry_loan_answers(gantry_loan *loan, const gantry_sample *input);

/* Sends the result and wakes its readers, whose number goes into `*n_readers` (may be NULL). The loan is ended, also by an error. */
gantry_status gantry_loan_send(gantry_loan *loan, size_t *n_readers);

/* Gives the room back unsent. */
void gantry_loan_drop(gantry_loan *loan);

/* --- the world ---------------------------------------------------------------------------------------------------------------------- */

/* Opens the snapshots of the world, and waits until they are there. Ended by gantry_snapshots_close. */
gantry_status gantry_snapshots_open(gantry_bus *bus, int64_t timeout_nanos, gantry_snapshots **snapshots);
void gantry_snapshots_close(gantry_snapshots *snapshots);

/* The newest snapshot; waits only for the first. GANTRY_NOTHING after `timeout_nanos`. Ended by gantry_world_release. */
gantry_status gantry_snapshots_newest(gantry_snapshots *snapshots, int64_t timeout_nanos, gantry_world **world);

/* The snapshot of exactly `tick`, for example of a frame; waits for it. GANTRY_FAILED if it is no longer kept. */
gantry_status gantry_snapshots_at(gantry_snapshots *snapshots, uint64_t tick, int64_t timeout_nanos, gantry_world **world);

/* Its header: tick, simulated time, episode, epoch. */
const gantry_snapshot_header *gantry_world_header(const gantry_world *world);

/* Its `*len` (may be NULL) actors, by rising id. */
const gantry_actor_record *gantry_world_actors(const gantry_world *world, size_t *len);

void gantry_world_release(gantry_world *world);

/* --- lockstep ----------------------------------------------------------------------------------------------------------------------- */

/* Joins as `name`, which no other process may use, and waits for the simulator. Open what is read before, so that nothing of the first tick
 * is missed. GANTRY_REFUSED. Ended by gantry_lockstep_leave. */
gantry_status gantry_lockstep_join(gantry_bus *bus, const char *name, int64_t timeout_nanos, gantry_lockstep **lockstep);

/* Acknowledges the last tick, and waits for the next until everything of it was sent: its snapshot, and every frame of a sensor that fired.
 * The simulator begins no tick before all participants acknowledged the last one. GANTRY_NOTHING after `timeout_nanos`: the tick that was
 * handed out last is acknowledged. A simulator that was restarted is joined again. */
gantry_status gantry_lockstep_next(gantry_lockstep *lockstep, int64_t timeout_nanos, gantry_world **world);

/* Acknowledges the last tick now, for a program that has to wait for something else. */
gantry_status gantry_lockstep_acknowledge(gantry_lockstep *lockstep);

/* Leaves: the simulator waits no longer. */
void gantry_lockstep_leave(gantry_lockstep *lockstep);

/* --- controls ----------------------------------------------------------------------------------------------------------------------- */

/* Opens the controls of vehicles as the writer `name`. Ended by gantry_controls_close; vehicles keep what they were told last. */
gantry_status gantry_controls_open(gantry_bus *bus, const char *name, gantry_controls **controls);

/* Sends `n_records` controls that answer the snapshot of `tick`. Values beyond their range are clamped by the simulator. Set lamps to
 * UINT32_MAX to leave them alone. */
gantry_status gantry_controls_send(gantry_controls *controls, uint64_t tick, const gantry_vehicle_control_record *records,
                                   size_t n_records);
void gantry_controls_close(gantry_controls *controls);

#ifdef __cplusplus
}
#endif

#endif
