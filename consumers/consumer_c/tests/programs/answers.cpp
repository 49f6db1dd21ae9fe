// Answers five ticks of a simulator in lockstep, and prints what it sees, for the test that started it.

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <thread>

#include "gantry/gantry.hpp"

using namespace std::chrono_literals;

namespace {

// FNV-1a, 64 bits.
uint64_t hash(gantry::Span<const uint8_t> bytes) {
    uint64_t hash = 0xcbf29ce484222325u;
    for (uint8_t byte : bytes) hash = (hash ^ byte) * 0x100000001b3u;
    return hash;
}

[[noreturn]] void fail(const char *what) {
    std::fprintf(stderr, "%s\n", what);
    std::exit(1);
}

template <class Call> void expect(gantry_status status, const char *words, Call call) {
    try {
        call();
    } catch (const gantry::Error &error) {
        if (error.status() == status && std::string(error.what()).find(words) != std::string::npos) return;
        fail(error.what());
    }
    fail(words);
}

void wrong_calls(const gantry::Bus &bus) {
    expect(GANTRY_NO_SUCH_TOPIC, "ego/front/depht", [&] { bus.reader("ego/front/depht", 0ns); });
    expect(GANTRY_ARGUMENT, "\"boxes\" is no type of results", [&] { bus.publisher("answers/x", "boxes"); });
    expect(GANTRY_ARGUMENT, "the description cannot be read", [&] { bus.publisher("answers/x", "text", "{"); });
    expect(GANTRY_REFUSED, "the simulator refused", [&] { bus.command(R"([{"do":"destroy","actor_id":999999}])"); });
    if (gantry_reader_take(nullptr, GANTRY_OLDEST, 0, nullptr) != GANTRY_ARGUMENT) fail("a reader of NULL was taken");
    gantry_bus *other = nullptr;
    if (gantry_bus_open_versions(GANTRY_ABI_VERSION + 1, GANTRY_SCHEMA_VERSION, nullptr, "other", &other) != GANTRY_SCHEMA || other)
        fail("a header of another version was taken");
    const char *null_program = nullptr;
    if (gantry_bus_open(nullptr, null_program, &other) != GANTRY_ARGUMENT) fail("a program without a name was taken");
}

void run() {
    gantry::Bus bus("answers");
    auto camera = bus.reader("ego/front/semantic", 60s);
    auto boxes = bus.publisher<gantry::Box2d>("answers/boxes", R"({"classes":["car"]})");
    auto image = bus.publisher("answers/image", "image");
    auto controls = bus.controls("answers");
    auto snapshots = bus.snapshots(60s);
    wrong_calls(bus);
    auto lockstep = bus.lockstep("answers", 60s);
    std::printf("joined\n");
    std::fflush(stdout);
    for (int n = 0; n < 5; ++n) {
        auto world = lockstep.next(60s);
        if (!world) fail("no tick within a minute");
        auto frame = camera.next(60s);
        while (frame && frame->tick() < world->tick()) frame = camera.next(60s);
        if (!frame || frame->tick() != world->tick()) fail("the tick has no frame");
        auto same = snapshots.at(frame->tick());
        if (!same || same->actors().size() != world->actors().size()) fail("the tick has no snapshot");
        const gantry::ActorRecord *car = nullptr;
        for (const auto &actor : world->actors())
            if (!car && actor.kind == GANTRY_ACTOR_VEHICLE) car = &actor;
        if (!car || world->actor(car->id) != car) fail("there is no vehicle");
        const gantry::Image seen = frame->image();
        std::printf("tick %llu hash %016llx %ux%u at %.3f\n", static_cast<unsigned long long>(frame->tick()),
                    static_cast<unsigned long long>(hash(frame->bytes())), seen.width, seen.height, car->world_from_actor.translation_m[0]);
        std::fflush(stdout);

        // Two boxes in place, of a loan with room for four.
        auto found = boxes.loan(4);
        found[0] = {{1.0f, 2.0f}, {3.5f, 4.5f}, 0.75f, 0, static_cast<uint32_t>(frame->tick()), 0};
        found[1] = {{0.0f, 0.0f}, {static_cast<float>(seen.width), static_cast<float>(seen.height)}, 0.5f, 0, 7, 0};
        found.answers(*frame);
        found.send(2);

        auto copy = image.loan(size_t{seen.width} * seen.height);
        for (uint32_t y = 0; y < seen.height; ++y) std::memcpy(copy.body().data() + size_t{y} * seen.width, seen.row(y), seen.width);
        copy.set_image(seen.width, seen.height, "class");
        copy.answers(*frame);
        copy.send();

        controls.send(frame->tick(), {{car->id, 1.0f, 0.0f, 0.0f, 0, 0, UINT32_MAX, 0}});
    }
    const auto counts = camera.counts();
    if (counts.taken < 5 || counts.lost != 0 || counts.refused != 0) fail("frames were lost");
    // A loan that is longer than its room says so, and is over.
    auto loan = image.loan(10);
    expect(GANTRY_FAILED, "10", [&] { loan.set_image(640, 480, "rgb8"); });
    lockstep.acknowledge();
    std::printf("done\n");
}

} // namespace

int main() {
    try {
        run();
    } catch (const std::exception &error) {
        fail(error.what());
    }
}
