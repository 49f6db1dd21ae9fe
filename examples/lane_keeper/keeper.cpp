// Keeps its lane by the painted lines that the front camera sees: keeper.py in C++, with the same numbers.
//
// An image is read where the simulator has written it. With OpenCV it is
//     cv::Mat(image.height, image.width, CV_8UC1, const_cast<uint8_t *>(image.data), image.row_stride)

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <string>

#include "gantry/gantry.hpp"

namespace {

using namespace std::chrono_literals;

// The camera's height over the road and its place ahead of the rear axle, the car's wheelbase, a lane's width.
constexpr double camera_height_m = 1.6, camera_ahead_m = 2.9, wheelbase_m = 2.9, lane_m = 3.5;
// Where the lane is looked for, metres ahead of the camera, and at which of these places the car aims.
constexpr std::array<double, 4> distances_m{5.0, 6.5, 8.0, 10.0};
constexpr size_t aim = 3;
// Angle of the wheels at full lock, radians.
constexpr double full_lock_rad = 1.0;

using Lane = std::array<double, distances_m.size()>;

// How far left of the car its lane's middle is, metres, at a distance ahead; `expected_m` if no line is seen.
// A row of the image shows the road at one distance, because the road is flat and the camera's height is known.
double lane_middle(const gantry::Image &classes, const double (&intrinsics_px)[4], double distance_m, double expected_m) {
    const auto [fx, fy, cx, cy] = intrinsics_px;
    const auto row = static_cast<uint32_t>(cy + fy * camera_height_m / distance_m);
    // The nearest line on the left and on the right, of those about half a lane away.
    constexpr double none = std::numeric_limits<double>::infinity();
    std::array<double, 2> lines_m{none, -none};
    for (uint32_t x = 0; x < classes.width; ++x) {
        bool is_painted = false;
        for (uint32_t y = row - 1; y < std::min(row + 2, classes.height); ++y) is_painted |= classes.row(y)[x] == GANTRY_CLASS_ROAD_LINES;
        const double left_m = -(x + 0.5 - cx) * distance_m / fx - expected_m;
        double &line_m = lines_m[left_m > 0.0 ? 0 : 1];
        if (is_painted && std::abs(std::abs(left_m) - lane_m / 2) < 0.9 && std::abs(left_m) < std::abs(line_m)) line_m = left_m;
    }
    double sum_m = 0.0;
    int n_lines = 0;
    for (const double line_m : lines_m)
        if (std::isfinite(line_m)) sum_m += line_m - std::copysign(lane_m / 2, line_m), ++n_lines;
    return n_lines ? expected_m + sum_m / n_lines : expected_m;
}

// The middle of the lane at each of `distances_m`; each place is looked for near where the nearer one leads.
Lane lane_ahead(const gantry::Image &classes, const double (&intrinsics_px)[4], const Lane &before_m) {
    Lane seen{};
    for (size_t i = 0; i < seen.size(); ++i) {
        const double expected_m = i == 0 ? before_m[0] : seen[i - 1] + before_m[i] - before_m[i - 1];
        const double found_m = lane_middle(classes, intrinsics_px, distances_m[i], expected_m);
        seen[i] = std::clamp(found_m, expected_m - 0.3, expected_m + 0.3);
    }
    return seen;
}

// A number of the settings, the JSON object in the last argument.
double setting(const std::string &settings, const std::string &name) {
    const size_t at = settings.find('"' + name + '"');
    const size_t colon = settings.find(':', at);
    if (at == std::string::npos || colon == std::string::npos) throw std::runtime_error("the settings in the last argument lack " + name);
    return std::strtod(settings.c_str() + colon + 1, nullptr);
}

double length(const double (&v)[3]) { return std::hypot(v[0], v[1], v[2]); }

// Drives `ticks` ticks; returns 1 if a painted line was crossed.
int run(const std::string &settings) {
    const double ticks = setting(settings, "ticks"), wanted_mps = setting(settings, "speed_mps");
    gantry::Bus bus("keeper");
    auto camera = bus.reader("ego/front/semantic", 60s);
    auto crossed = bus.reader("ego/lines/lane_invasion", 60s);
    auto path = bus.publisher<gantry::PathPoint>("keeper/lane");
    auto controls = bus.controls("keeper");
    auto lockstep = bus.lockstep("keeper", 60s);
    Lane seen{};
    uint32_t car_id = 0;
    double start_m[3] = {}, moved_m[3] = {};
    int crossings = 0;
    for (int n = 0; n <= ticks; ++n) {
        const auto world = lockstep.next(60s);
        if (!world) throw std::runtime_error("no tick within a minute");
        const auto actors = world->actors();
        const auto *car = n == 0 ? std::find_if(actors.begin(), actors.end(), [](auto &it) { return it.kind == GANTRY_ACTOR_VEHICLE; })
                                 : world->actor(car_id);
        if (!car || car == actors.end()) throw std::runtime_error("there is no vehicle");
        car_id = car->id;
        const auto &at_m = car->world_from_actor.translation_m;
        if (n == 0) std::copy_n(at_m, 3, start_m);
        for (int i = 0; i < 3; ++i) moved_m[i] = at_m[i] - start_m[i];

        auto frame = camera.next(60s);
        while (frame && frame->tick() < world->tick()) frame = camera.next(60s);
        if (!frame) throw std::runtime_error("no image within a minute");
        seen = lane_ahead(frame->image(), frame->frame().intrinsics_px, seen);

        auto points = path.loan(seen.size());
        const float unknown = std::numeric_limits<float>::quiet_NaN();
        for (size_t i = 0; i < seen.size(); ++i)
            points[i] = {{{distances_m[i], seen[i], -camera_height_m}, {0.0, 0.0, 0.0, 1.0}}, unknown, unknown, unknown, unknown, {}};
        points.answers(*frame);
        points.send(seen.size());

        // Pure pursuit: the arc through the middle of the lane ahead.
        const double ahead_m = distances_m[aim] + camera_ahead_m, left_m = seen[aim];
        const double curvature = 2.0 * left_m / (ahead_m * ahead_m + left_m * left_m);
        const double pedal = std::clamp(0.4 * (wanted_mps - length(car->velocity_in_world_mps)), -1.0, 0.8);
        const double steer = std::clamp(std::atan(wheelbase_m * curvature) / full_lock_rad, -1.0, 1.0);
        gantry::VehicleControl control{};
        control.actor_id = car_id;
        control.throttle_ratio = static_cast<float>(std::max(pedal, 0.0));
        control.brake_ratio = static_cast<float>(std::max(-pedal, 0.0));
        control.steer_ratio = static_cast<float>(steer);
        control.lamps = UINT32_MAX;
        controls.send(world->tick(), {control});
        while (crossed.poll()) ++crossings;
    }
    std::printf("%.0f m driven, %d lines crossed\n", length(moved_m), crossings);
    return crossings ? 1 : 0;
}

} // namespace

int main(int argc, char **argv) {
    try {
        return run(argc > 1 ? argv[argc - 1] : "");
    } catch (const std::exception &error) {
        std::fprintf(stderr, "error: %s\n", error.what());
        return 1;
    }
}
