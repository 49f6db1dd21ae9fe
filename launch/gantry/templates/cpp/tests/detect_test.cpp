// The detector on images of a few pixels.

#include <array>
#include <cstdio>
#include <cstdlib>

#include "detect.hpp"

namespace {

void expect(bool holds, const char *what) {
    if (holds) return;
    std::fprintf(stderr, "not so: %s\n", what);
    std::exit(1);
}

bool is_at(const gantry::Box2d &box, float left, float top, float right, float bottom) {
    return box.min_px[0] == left && box.min_px[1] == top && box.max_px[0] == right && box.max_px[1] == bottom;
}

void two_cars_side_by_side_get_a_box_each_and_a_lamp_gets_none() {
    constexpr uint32_t width = 20, height = 10;
    std::array<uint8_t, width * height> pixels{};
    const auto paint = [&](uint32_t left, uint32_t top, uint32_t right, uint32_t bottom) {
        for (uint32_t y = top; y < bottom; ++y)
            for (uint32_t x = left; x < right; ++x) pixels[y * width + x] = GANTRY_CLASS_CAR;
    };
    paint(1, 2, 7, 6);
    paint(10, 4, 15, 9);
    paint(18, 5, 19, 6);
    const auto boxes = {{name}}::cars({pixels.data(), width, height, width, 1});
    expect(boxes.size() == 2, "there are two boxes");
    expect(is_at(boxes[0], 1, 2, 7, 6) && is_at(boxes[1], 10, 4, 15, 9), "they lie round the cars");
}

void an_image_without_pixels_has_no_cars() { expect({{name}}::cars({nullptr, 0, 0, 0, 1}).empty(), "there is no box"); }

} // namespace

int main() {
    two_cars_side_by_side_get_a_box_each_and_a_lamp_gets_none();
    an_image_without_pixels_has_no_cars();
    std::puts("2 passed");
}
