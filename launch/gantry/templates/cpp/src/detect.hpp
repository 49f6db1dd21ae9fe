// Finds cars in an image of class numbers. It stands in for a detector of yours: the simulator
// labels every pixel, so that its boxes are exact.
#pragma once

#include <cstdint>
#include <vector>

#include "gantry/gantry.hpp"

namespace {{name}} {

// Narrower groups of columns are no car, pixels.
constexpr uint32_t min_width_px = 4;

// The box round the pixels of cars in the columns left to right, without `right` itself.
inline gantry::Box2d box_round(const gantry::Image &classes, uint32_t left, uint32_t right) {
    uint32_t top = classes.height, bottom = 0;
    for (uint32_t y = 0; y < classes.height; ++y)
        for (uint32_t x = left; x < right; ++x)
            if (classes.row(y)[x] == GANTRY_CLASS_CAR) {
                top = y < top ? y : top;
                bottom = y + 1;
            }
    gantry::Box2d box{};
    box.min_px[0] = static_cast<float>(left), box.min_px[1] = static_cast<float>(top);
    box.max_px[0] = static_cast<float>(right), box.max_px[1] = static_cast<float>(bottom);
    box.score = 1.0F;
    box.class_ = GANTRY_CLASS_CAR;
    return box;
}

// A box round each group of neighbouring columns with pixels of cars. Cars that cover one another
// share a box.
inline std::vector<gantry::Box2d> cars(const gantry::Image &classes) {
    std::vector<bool> has_car(classes.width + 1, false);
    for (uint32_t y = 0; y < classes.height; ++y)
        for (uint32_t x = 0; x < classes.width; ++x)
            if (classes.row(y)[x] == GANTRY_CLASS_CAR) has_car[x] = true;
    std::vector<gantry::Box2d> boxes;
    uint32_t left = 0;
    // The column behind the last has no car, so that every group ends.
    for (uint32_t x = 0; x <= classes.width; ++x) {
        const bool had_car = x > 0 && has_car[x - 1];
        if (has_car[x] && !had_car) left = x;
        if (!has_car[x] && had_car && x - left >= min_width_px) boxes.push_back(box_round(classes, left, x));
    }
    return boxes;
}

} // namespace {{name}}
