// The program as a process beside a simulator, both in a domain of their own:
//     simulator_test PROGRAM LAUNCH_FILE SIMD

#include <algorithm>
#include <array>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <stdexcept>
#include <string>
#include <vector>

#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include "gantry/gantry.hpp"

namespace {

using namespace std::chrono_literals;

// Long enough for a slow machine that draws without a GPU.
constexpr auto patience = 60s;

// A process that ends with this one at the latest.
class Process {
public:
    explicit Process(std::vector<std::string> words) : name_(words[0]), pid_(fork()) {
        if (pid_ < 0) throw std::runtime_error("no process can be started");
        if (pid_ > 0) return;
        prctl(PR_SET_PDEATHSIG, SIGTERM);
        std::vector<char *> arguments;
        for (auto &word : words) arguments.push_back(word.data());
        arguments.push_back(nullptr);
        execvp(arguments[0], arguments.data());
        std::perror(arguments[0]);
        _exit(127);
    }
    Process(const Process &) = delete;
    Process &operator=(const Process &) = delete;
    ~Process() {
        if (pid_ > 0) stop();
    }
    // Ends it as Ctrl-C does, and returns its exit code.
    int stop() {
        int status = 0;
        kill(pid_, SIGINT);
        waitpid(pid_, &status, 0);
        pid_ = 0;
        return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    }
    void must_run() const {
        if (waitpid(pid_, nullptr, WNOHANG) != 0) throw std::runtime_error(name_ + " has ended");
    }

private:
    std::string name_;
    pid_t pid_;
};

// `there` turned and moved by `pose`.
std::array<double, 3> moved(const gantry::Pose &pose, const std::array<double, 3> &there) {
    const auto &q = pose.rotation_xyzw;
    const auto cross = [&](const std::array<double, 3> &v) {
        return std::array<double, 3>{q[1] * v[2] - q[2] * v[1], q[2] * v[0] - q[0] * v[2], q[0] * v[1] - q[1] * v[0]};
    };
    const auto once = cross(there), twice = cross(once);
    std::array<double, 3> place{};
    for (size_t i = 0; i < 3; ++i) place[i] = pose.translation_m[i] + there[i] + 2.0 * (q[3] * once[i] + twice[i]);
    return place;
}

// Spawns a car 12 m ahead of the ego vehicle, turned as it is, and returns its id.
uint32_t spawn_car_ahead(const gantry::Bus &bus) {
    const auto world = bus.snapshots(patience).newest(patience);
    if (!world) throw std::runtime_error("no snapshot came");
    const auto actors = world->actors();
    // The ego vehicle is spawned before all others.
    const auto *ego = std::find_if(actors.begin(), actors.end(), [](auto &it) { return it.kind == GANTRY_ACTOR_VEHICLE; });
    if (ego == actors.end()) throw std::runtime_error("there is no vehicle");
    const auto at = moved(ego->world_from_actor, {12.0, 0.0, 0.3});
    const auto &turn = ego->world_from_actor.rotation_xyzw;
    std::array<char, 512> command{};
    std::snprintf(command.data(), command.size(),
                  R"([{"do":"spawn","type_id":"vehicle.audi.tt","pose":{"translation_m":[%.9f,%.9f,%.9f],"rotation_xyzw":[%.9f,%.9f,%.9f,%.9f]}}])",
                  at[0], at[1], at[2], turn[0], turn[1], turn[2], turn[3]);
    const std::string answer = bus.command(command.data(), patience), key = "\"actor_id\":";
    const size_t found = answer.find(key);
    if (found == std::string::npos) throw std::runtime_error("the car cannot be spawned: " + answer);
    return static_cast<uint32_t>(std::strtoul(answer.c_str() + found + key.size(), nullptr, 10));
}

void expect(bool holds, const std::string &what) {
    if (!holds) throw std::runtime_error("not so: " + what);
}

// Looks at one tick: the boxes answer its image, and one lies round the car's own pixels, which another image of the same tick shows.
void check_tick(const gantry::Bus &bus, gantry::Reader &boxes, gantry::Reader &objects, uint32_t car) {
    bus.command(R"([{"do":"step","n":1}])", patience);
    const auto numbers = objects.next(patience);
    const auto found = boxes.next(patience);
    expect(numbers && found, "image and boxes have come");
    expect(found->tick() == numbers->tick(), "the boxes are those of this tick");
    const auto inputs = found->inputs();
    expect(inputs.size() == 1 && inputs[0].tick == found->tick(), "they answer one image of this tick");
    const auto image = numbers->image();
    std::array<float, 2> low{1e9F, 1e9F}, high{};
    for (uint32_t y = 0; y < image.height; ++y)
        for (uint32_t x = 0; x < image.width; ++x)
            if (reinterpret_cast<const uint32_t *>(image.row(y))[x] == car) {
                low = {std::min(low[0], static_cast<float>(x)), std::min(low[1], static_cast<float>(y))};
                high = {std::max(high[0], static_cast<float>(x) + 1), std::max(high[1], static_cast<float>(y) + 1)};
            }
    const auto records = found->elements<gantry::Box2d>();
    const auto is_it = [&](const gantry::Box2d &box) {
        return box.min_px[0] == low[0] && box.min_px[1] == low[1] && box.max_px[0] == high[0] && box.max_px[1] == high[1];
    };
    expect(std::any_of(records.begin(), records.end(), is_it), "a box lies round the car's pixels");
}

void run(const std::string &program, const std::string &launch, const std::string &simd) {
    const std::string domain = "{{name}}_test_" + std::to_string(getpid());
    setenv("GANTRY_DOMAIN", domain.c_str(), 1);
    // Without traffic, and with the numbers of the objects in the image. The world stands still between steps.
    Process simulator({simd, "--launch", launch, "--domain", domain, "--set", "scenario.mode=\"stepped\"", "--set", "scenario.vehicles=0", "--set",
                       "sensor.front.modalities=[\"semantic\", \"instance\"]", "--set", "sensor.front.width_px=320", "--set",
                       "sensor.front.height_px=240"});
    gantry::Bus bus("test");
    auto objects = bus.reader("ego/front/instance", patience);
    const uint32_t car = spawn_car_ahead(bus);
    Process detector({program});
    auto boxes = bus.reader("{{name}}/boxes", patience);
    // It reads the camera before it becomes the writer of its boxes.
    for (auto end = std::chrono::steady_clock::now() + patience; !boxes.has_writer(); usleep(1000)) {
        detector.must_run();
        simulator.must_run();
        expect(std::chrono::steady_clock::now() < end, "the program publishes boxes");
    }
    for (int n = 0; n < 5; ++n) check_tick(bus, boxes, objects, car);
    expect(detector.stop() == 0, "the program ends in order");
}

} // namespace

int main(int argc, char **argv) {
    if (argc != 4) {
        std::fprintf(stderr, "usage: simulator_test PROGRAM LAUNCH_FILE SIMD\n");
        return 2;
    }
    try {
        run(argv[1], argv[2], argv[3]);
        std::puts("1 passed");
        return 0;
    } catch (const std::exception &error) {
        std::fprintf(stderr, "error: %s\n", error.what());
        return 1;
    }
}
