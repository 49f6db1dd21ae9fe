// Publishes boxes round the cars that the front camera sees, for every image.

#include <chrono>
#include <csignal>
#include <cstdio>
#include <exception>
#include <optional>

#include "detect.hpp"
#include "gantry/gantry.hpp"

namespace {

using namespace std::chrono_literals;

// What is read. A detector of your own reads ego/front/rgb, whose pixels are B G R A.
constexpr const char *camera_topic = "ego/front/semantic";
// What is published; `gantry topic hz` and the viewer show it by this name.
constexpr const char *boxes_topic = "{{name}}/boxes";
// How long a wait may last before Ctrl-C is looked for.
constexpr auto glance = 200ms;

volatile std::sig_atomic_t is_stopped = 0;
extern "C" void stop(int) { is_stopped = 1; }

// Waits for a simulator that is not there yet; nothing after Ctrl-C.
std::optional<gantry::Reader> wait_for_camera(const gantry::Bus &bus) {
    while (!is_stopped) {
        try {
            return bus.reader(camera_topic, glance);
        } catch (const gantry::Error &error) {
            if (error.status() != GANTRY_NO_SUCH_TOPIC) throw;
        }
    }
    return std::nullopt;
}

void run() {
    gantry::Bus bus("{{name}}");
    auto camera = wait_for_camera(bus);
    if (!camera) return;
    // Last, because who waits for this writer may then let the simulator go on.
    auto boxes = bus.publisher<gantry::Box2d>(boxes_topic);
    while (!is_stopped) {
        // Every image in order; `latest` skips those that came while this program was busy.
        const auto image = camera->next(glance);
        // Naming the image makes latency measurable, and places the boxes in the viewer.
        if (image) boxes.send({{name}}::cars(image->image()), {&*image});
    }
    const auto counts = camera->counts();
    std::printf("%llu images were lost\n", static_cast<unsigned long long>(counts.lost));
}

} // namespace

int main() {
    // Ctrl-C and the launcher's end: the ports close in order.
    std::signal(SIGINT, stop);
    std::signal(SIGTERM, stop);
    try {
        run();
        return 0;
    } catch (const std::exception &error) {
        std::fprintf(stderr, "error: %s\n", error.what());
        return 1;
    }
}
