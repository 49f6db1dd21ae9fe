/// Gantry for programs in C++17: gantry.h with handles that end themselves, exceptions and spans over shared memory. Nothing is copied.
///
/// A call that fails throws gantry::Error with the library's sentence; one that found nothing in time returns an empty std::optional.
/// Threads and ownership are those of gantry.h: a Bus may be used by many threads, everything else by one at a time. Handles can be moved.
///
///     gantry::Bus bus("my_detector");
///     auto camera = bus.reader("ego/front/rgb");
///     auto boxes = bus.publisher<gantry::Box2d>("my_detector/boxes");
///     while (auto frame = camera.next(std::chrono::seconds(10))) {
///         gantry::Image image = frame->image();   // cv::Mat(image.height, image.width, CV_8UC4, const_cast<uint8_t *>(image.data), image.row_stride)
///         boxes.send(detect(image), {&*frame});
///     }
#ifndef GANTRY_GANTRY_HPP
#define GANTRY_GANTRY_HPP

#include <algorithm>
#include <chrono>
#include <cstring>
#include <initializer_list>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "gantry/gantry.h"

namespace gantry {

using Pose = gantry_pose;
using FrameHeader = gantry_frame_header;
using ResultHeader = gantry_result_header;
using InputRecord = gantry_input_record;
using SnapshotHeader = gantry_snapshot_header;
using ActorRecord = gantry_actor_record;
using VehicleControl = gantry_vehicle_control_record;
using Box2d = gantry_box2d;
using Box3d = gantry_box3d;
using Track = gantry_track;
using PoseEstimate = gantry_pose_estimate;
using Odometry = gantry_odometry;
using PathPoint = gantry_path_point;
using Scalar = gantry_scalar;
using LidarPoint = gantry_lidar_point;
using ImuSample = gantry_imu_sample;
using DvsEvent = gantry_dvs_event;

/// How long opening waits if it is told nothing else.
inline constexpr std::chrono::nanoseconds patience{GANTRY_PATIENCE};
/// A wait without a limit.
inline constexpr std::chrono::nanoseconds forever{GANTRY_FOREVER};

/// A call that failed. what() is the library's sentence.
class Error : public std::runtime_error {
public:
    explicit Error(gantry_status status) : std::runtime_error(gantry_last_error()), status_(status) {}
    Error(gantry_status status, const std::string &sentence) : std::runtime_error(sentence), status_(status) {}
    gantry_status status() const noexcept { return status_; }

private:
    gantry_status status_;
};

/// Elements that lie one after the other in memory of something else.
template <class T> class Span {
public:
    constexpr Span() noexcept = default;
    constexpr Span(T *data, size_t size) noexcept : data_(data), size_(size) {}
    constexpr T *data() const noexcept { return data_; }
    constexpr size_t size() const noexcept { return size_; }
    constexpr bool empty() const noexcept { return size_ == 0; }
    constexpr T *begin() const noexcept { return data_; }
    constexpr T *end() const noexcept { return data_ + size_; }
    constexpr T &operator[](size_t i) const noexcept { return data_[i]; }

private:
    T *data_ = nullptr;
    size_t size_ = 0;
};

/// Pixels in shared memory. Row y begins at data + y * row_stride.
struct Image {
    const uint8_t *data;
    uint32_t width, height, row_stride, pixel_bytes;
    const uint8_t *row(uint32_t y) const noexcept { return data + size_t{y} * row_stride; }
};

namespace detail {
/// Whether something was found; throws for an error.
inline bool found(gantry_status status) {
    if (status < 0) throw Error(status);
    return status == GANTRY_OK;
}
template <class T, void (*end)(T *)> struct Ender {
    void operator()(T *it) const noexcept { end(it); }
};
template <class T, void (*end)(T *)> using Handle = std::unique_ptr<T, Ender<T, end>>;
template <class T> struct ResultType;
template <> struct ResultType<Box2d> { static constexpr const char *name = "boxes2d"; };
template <> struct ResultType<Box3d> { static constexpr const char *name = "boxes3d"; };
template <> struct ResultType<Track> { static constexpr const char *name = "tracks"; };
template <> struct ResultType<PoseEstimate> { static constexpr const char *name = "pose"; };
template <> struct ResultType<Odometry> { static constexpr const char *name = "odometry"; };
template <> struct ResultType<PathPoint> { static constexpr const char *name = "path"; };
template <> struct ResultType<Scalar> { static constexpr const char *name = "scalars"; };
template <> struct ResultType<VehicleControl> { static constexpr const char *name = "control"; };
} // namespace detail

/// A frame or a result in shared memory, which is given back when this ends. A reader may hold three, so do not keep them.
class Sample {
public:
    explicit Sample(gantry_sample *it) : it_(it) {}
    const gantry_sample *get() const noexcept { return it_.get(); }
    bool is_frame() const noexcept { return gantry_sample_frame(get()) != nullptr; }
    /// Header of a frame; throws for a result.
    const FrameHeader &frame() const {
        if (auto *header = gantry_sample_frame(get())) return *header;
        throw Error(GANTRY_ARGUMENT, std::string(topic()) + " carries results; ask for result()");
    }
    /// Header of a result; throws for a frame.
    const ResultHeader &result() const {
        if (auto *header = gantry_sample_result(get())) return *header;
        throw Error(GANTRY_ARGUMENT, std::string(topic()) + " carries frames; ask for frame()");
    }
    uint64_t tick() const noexcept {
        auto *frame = gantry_sample_frame(get());
        return frame ? frame->tick : gantry_sample_result(get())->tick;
    }
    const char *topic() const noexcept { return gantry_sample_topic(get()); }
    uint64_t taken_mono_nanos() const noexcept { return gantry_sample_taken_mono_nanos(get()); }
    Span<const uint8_t> bytes() const noexcept {
        size_t len = 0;
        auto *data = gantry_sample_bytes(get(), &len);
        return {data, len};
    }
    /// The payload as pixels, points or records; throws if `T` is not of the size of an element or of a part of it.
    template <class T> Span<const T> elements() const {
        static_assert(std::is_trivially_copyable_v<T>, "elements are plain numbers");
        auto *frame = gantry_sample_frame(get());
        auto *result = gantry_sample_result(get());
        const uint32_t element_bytes = frame ? frame->element_bytes : result->element_bytes;
        if (element_bytes % sizeof(T) != 0)
            throw Error(GANTRY_ARGUMENT, std::string(topic()) + " has elements of " + std::to_string(element_bytes) + " bytes, not of "
                                             + std::to_string(sizeof(T)));
        size_t len_bytes = bytes().size();
        // Behind a result's records may be a tail of runs or key points.
        if (result && result->n_items != 0) len_bytes = std::min(len_bytes, size_t{result->n_items} * element_bytes);
        return {reinterpret_cast<const T *>(bytes().data()), len_bytes / sizeof(T)};
    }
    /// The payload as an image; throws for a list.
    Image image() const {
        auto *frame = gantry_sample_frame(get());
        const Image image = frame ? Image{bytes().data(), frame->width, frame->height, frame->row_stride, frame->element_bytes}
                                  : Image{bytes().data(), result().width, result().height, result().row_stride, result().element_bytes};
        if (image.row_stride == 0) throw Error(GANTRY_ARGUMENT, std::string(topic()) + " carries no images");
        return image;
    }
    Span<const InputRecord> inputs() const noexcept {
        size_t len = 0;
        auto *data = gantry_sample_inputs(get(), &len);
        return {data, len};
    }

private:
    detail::Handle<gantry_sample, gantry_sample_release> it_;
};

/// The reading end of a topic.
class Reader {
public:
    explicit Reader(gantry_reader *it) : it_(it) {}
    gantry_reader *get() const noexcept { return it_.get(); }
    /// The oldest sample that waits, or the next that comes.
    std::optional<Sample> next(std::chrono::nanoseconds timeout = patience) { return take(GANTRY_OLDEST, timeout); }
    /// The newest, past all older ones.
    std::optional<Sample> latest(std::chrono::nanoseconds timeout = patience) { return take(GANTRY_NEWEST, timeout); }
    /// What waits now, if anything.
    std::optional<Sample> poll() { return next(std::chrono::nanoseconds(0)); }
    gantry_counts counts() const {
        gantry_counts counts{};
        counts.struct_bytes = sizeof counts;
        detail::found(gantry_reader_counts(get(), &counts));
        return counts;
    }
    bool has_writer() const noexcept { return gantry_reader_has_writer(get()); }
    /// For poll and epoll; see gantry_reader_fd.
    int fd() const noexcept { return gantry_reader_fd(get()); }

private:
    std::optional<Sample> take(gantry_which which, std::chrono::nanoseconds timeout) {
        gantry_sample *sample = nullptr;
        if (!detail::found(gantry_reader_take(get(), which, timeout.count(), &sample))) return std::nullopt;
        return Sample(sample);
    }
    detail::Handle<gantry_reader, gantry_reader_close> it_;
};

/// A slot of shared memory for one result. Send it, or let it go.
class Loan {
public:
    explicit Loan(gantry_loan *it) : it_(it) {}
    gantry_loan *get() const noexcept { return it_.get(); }
    ResultHeader &header() const noexcept { return *gantry_loan_header(get()); }
    Span<uint8_t> body() const noexcept {
        size_t room = 0;
        auto *data = gantry_loan_body(get(), &room);
        return {data, room};
    }
    void answers(const Sample &input) { detail::found(gantry_loan_answers(get(), input.get())); }
    void set_list(uint32_t n_items, uint32_t element_bytes, uint64_t tail_bytes = 0) {
        detail::found(gantry_loan_set_list(get(), n_items, element_bytes, tail_bytes));
    }
    void set_image(uint32_t width_px, uint32_t height_px, const char *pixel_format) {
        detail::found(gantry_loan_set_image(get(), width_px, height_px, pixel_format));
    }
    void set_tensor(const char *element_type, const std::vector<uint32_t> &sizes) {
        detail::found(gantry_loan_set_tensor(get(), element_type, sizes.data(), sizes.size()));
    }
    /// Sends it; returns the number of readers that received it. The loan is over.
    size_t send() {
        size_t n_readers = 0;
        detail::found(gantry_loan_send(it_.release(), &n_readers));
        return n_readers;
    }

private:
    detail::Handle<gantry_loan, gantry_loan_drop> it_;
};

/// The writing end of a topic of results of any type.
class AnyPublisher {
public:
    explicit AnyPublisher(gantry_publisher *it) : it_(it) {}
    gantry_publisher *get() const noexcept { return it_.get(); }
    size_t n_readers() const noexcept { return gantry_publisher_readers(get()); }
    Loan loan(size_t body_bytes) {
        gantry_loan *loan = nullptr;
        detail::found(gantry_publisher_loan(get(), body_bytes, &loan));
        return Loan(loan);
    }

private:
    detail::Handle<gantry_publisher, gantry_publisher_close> it_;
};

/// Records in shared memory that are being filled; all zero at first.
template <class T> class ListLoan {
public:
    explicit ListLoan(Loan loan) : loan_(std::move(loan)) {
        const auto body = loan_.body();
        std::memset(body.data(), 0, body.size());
    }
    Span<T> records() const noexcept {
        const auto body = loan_.body();
        return {reinterpret_cast<T *>(body.data()), body.size() / sizeof(T)};
    }
    T &operator[](size_t i) const noexcept { return records()[i]; }
    ResultHeader &header() const noexcept { return loan_.header(); }
    void answers(const Sample &input) { loan_.answers(input); }
    /// Sends the first `n` records.
    size_t send(size_t n) {
        loan_.set_list(static_cast<uint32_t>(n), sizeof(T));
        return loan_.send();
    }

private:
    Loan loan_;
};

/// Publishes lists of `T`: boxes, tracks, points of a path.
template <class T> class Publisher {
public:
    explicit Publisher(AnyPublisher publisher) : publisher_(std::move(publisher)) {}
    size_t n_readers() const noexcept { return publisher_.n_readers(); }
    /// Room for up to `max_records`, to be filled in place.
    ListLoan<T> loan(size_t max_records) { return ListLoan<T>(publisher_.loan(max_records * sizeof(T))); }
    /// Sends a copy of `records`, which answer `inputs`; returns the number of readers that received it.
    size_t send(const std::vector<T> &records, std::initializer_list<const Sample *> inputs) {
        auto list = loan(records.size());
        if (!records.empty()) std::memcpy(list.records().data(), records.data(), records.size() * sizeof(T));
        for (auto *input : inputs) list.answers(*input);
        return list.send(records.size());
    }

private:
    AnyPublisher publisher_;
};

/// All actors after one tick.
class World {
public:
    explicit World(gantry_world *it) : it_(it) {}
    const SnapshotHeader &header() const noexcept { return *gantry_world_header(it_.get()); }
    uint64_t tick() const noexcept { return header().tick; }
    /// By rising id.
    Span<const ActorRecord> actors() const noexcept {
        size_t len = 0;
        auto *data = gantry_world_actors(it_.get(), &len);
        return {data, len};
    }
    /// The actor with this id; NULL if there is none.
    const ActorRecord *actor(uint32_t id) const noexcept {
        const auto all = actors();
        auto *at = std::lower_bound(all.begin(), all.end(), id, [](const ActorRecord &it, uint32_t wanted) { return it.id < wanted; });
        return at != all.end() && at->id == id ? at : nullptr;
    }

private:
    detail::Handle<gantry_world, gantry_world_release> it_;
};

/// The last 32 snapshots.
class Snapshots {
public:
    explicit Snapshots(gantry_snapshots *it) : it_(it) {}
    std::optional<World> newest(std::chrono::nanoseconds timeout = patience) {
        gantry_world *world = nullptr;
        if (!detail::found(gantry_snapshots_newest(it_.get(), timeout.count(), &world))) return std::nullopt;
        return World(world);
    }
    /// The world that a frame of `tick` shows.
    std::optional<World> at(uint64_t tick, std::chrono::nanoseconds timeout = patience) {
        gantry_world *world = nullptr;
        if (!detail::found(gantry_snapshots_at(it_.get(), tick, timeout.count(), &world))) return std::nullopt;
        return World(world);
    }

private:
    detail::Handle<gantry_snapshots, gantry_snapshots_close> it_;
};

/// A place in lockstep, which is left when this ends.
class Lockstep {
public:
    explicit Lockstep(gantry_lockstep *it) : it_(it) {}
    /// Acknowledges the last tick, and waits until everything of the next was sent.
    std::optional<World> next(std::chrono::nanoseconds timeout = patience) {
        gantry_world *world = nullptr;
        if (!detail::found(gantry_lockstep_next(it_.get(), timeout.count(), &world))) return std::nullopt;
        return World(world);
    }
    void acknowledge() { detail::found(gantry_lockstep_acknowledge(it_.get())); }

private:
    detail::Handle<gantry_lockstep, gantry_lockstep_leave> it_;
};

/// A writer of vehicle controls.
class Controls {
public:
    explicit Controls(gantry_controls *it) : it_(it) {}
    /// Sends controls that answer the snapshot of `tick`.
    void send(uint64_t tick, const std::vector<VehicleControl> &records) {
        detail::found(gantry_controls_send(it_.get(), tick, records.data(), records.size()));
    }

private:
    detail::Handle<gantry_controls, gantry_controls_close> it_;
};

/// A domain that this process has joined.
class Bus {
public:
    /// Joins `domain` (NULL: GANTRY_DOMAIN, else "gantry") as `program`. The simulator need not run yet.
    explicit Bus(const std::string &program, const char *domain = nullptr) {
        gantry_bus *bus = nullptr;
        detail::found(gantry_bus_open(domain, program.c_str(), &bus));
        it_.reset(bus);
    }
    gantry_bus *get() const noexcept { return it_.get(); }
    /// Opens a topic of frames or of results, and waits until it is there.
    Reader reader(const std::string &topic, std::chrono::nanoseconds timeout = patience) const {
        gantry_reader *reader = nullptr;
        detail::found(gantry_reader_open(get(), topic.c_str(), timeout.count(), &reader));
        return Reader(reader);
    }
    /// Opens a topic of results that are lists of `T`. `about` is its description as JSON.
    template <class T> Publisher<T> publisher(const std::string &topic, const char *about = nullptr) const {
        return Publisher<T>(publisher(topic, detail::ResultType<T>::name, about));
    }
    /// Opens a topic of results of any type: "image", "tensor", "text", …
    AnyPublisher publisher(const std::string &topic, const char *result_type, const char *about = nullptr) const {
        gantry_publisher *publisher = nullptr;
        detail::found(gantry_publisher_open(get(), topic.c_str(), result_type, about, &publisher));
        return AnyPublisher(publisher);
    }
    Snapshots snapshots(std::chrono::nanoseconds timeout = patience) const {
        gantry_snapshots *snapshots = nullptr;
        detail::found(gantry_snapshots_open(get(), timeout.count(), &snapshots));
        return Snapshots(snapshots);
    }
    /// Joins lockstep as `name`. Open what is read before.
    Lockstep lockstep(const std::string &name, std::chrono::nanoseconds timeout = patience) const {
        gantry_lockstep *lockstep = nullptr;
        detail::found(gantry_lockstep_join(get(), name.c_str(), timeout.count(), &lockstep));
        return Lockstep(lockstep);
    }
    Controls controls(const std::string &name) const {
        gantry_controls *controls = nullptr;
        detail::found(gantry_controls_open(get(), name.c_str(), &controls));
        return Controls(controls);
    }
    /// Sends a JSON list of commands, and returns the answer's JSON.
    std::string command(const std::string &commands, std::chrono::nanoseconds timeout = patience) const {
        const char *answer = "";
        detail::found(gantry_command(get(), commands.c_str(), timeout.count(), &answer));
        return answer;
    }
    /// The newest text of a document such as world/info; empty if none came in time.
    std::optional<std::string> document(const std::string &name, std::chrono::nanoseconds timeout = patience) const {
        const char *text = nullptr;
        if (!detail::found(gantry_document(get(), name.c_str(), timeout.count(), &text))) return std::nullopt;
        return std::string(text);
    }

private:
    detail::Handle<gantry_bus, gantry_bus_close> it_;
};

} // namespace gantry

#endif
