// C++ wrapper of a camera of calib.h, with ownership, move semantics and exceptions.

#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "calib.h"

namespace calib {

struct SiteDeleter {
    void operator()(CalibSite *site) const noexcept { calib_site_free(site); }
};

struct CameraDeleter {
    void operator()(CalibCamera *camera) const noexcept { calib_camera_free(camera); }
};

using Site = std::unique_ptr<CalibSite, SiteDeleter>;

inline void expect(CalibResult result, const char *error = nullptr)
{
    if (result != CALIB_RESULT_OK) {
        throw std::runtime_error(error ? error : calib_result_text(static_cast<std::int32_t>(result)));
    }
}

inline Site parse(const std::string &json)
{
    char error[512];
    CalibSite *site = nullptr;
    expect(calib_site_parse(json.data(), json.size(), &site, error, sizeof error), error);
    return Site(site);
}

// Floor points, in metres, and the status of each.
struct Floor {
    std::vector<double> x, y;
    std::vector<std::uint8_t> status;
};

class Camera {
public:
    Camera(const Site &site, const std::string &id, const CalibStream &stream = {})
    {
        char error[512];
        CalibCamera *camera = nullptr;
        expect(calib_site_camera(site.get(), id.c_str(), nullptr, &stream, &camera, error, sizeof error), error);
        camera_.reset(camera);
    }

    Floor to_floor(const std::vector<double> &u, const std::vector<double> &v, double height_m = 0.0) const
    {
        if (u.size() != v.size()) {
            throw std::invalid_argument("u and v must have the same size");
        }
        const std::size_t count = u.size();
        Floor floor{std::vector<double>(count), std::vector<double>(count), std::vector<std::uint8_t>(count)};
        expect(calib_camera_to_floor(camera_.get(), height_m, count, u.data(), v.data(), floor.x.data(),
                                     floor.y.data(), floor.status.data()));
        return floor;
    }

    // `boxes` contains four numbers for each box, in the order of `form`, a CALIB_BOX.
    Floor boxes_to_floor(std::uint32_t form, const std::vector<double> &boxes, double height_m = 0.0) const
    {
        if (boxes.size() % 4 != 0) {
            throw std::invalid_argument("boxes must contain four numbers for each box");
        }
        const std::size_t count = boxes.size() / 4;
        Floor floor{std::vector<double>(count), std::vector<double>(count), std::vector<std::uint8_t>(count)};
        expect(calib_camera_boxes_to_floor(camera_.get(), height_m, form, count, boxes.data(), floor.x.data(),
                                           floor.y.data(), floor.status.data()));
        return floor;
    }

    const CalibCamera *handle() const noexcept { return camera_.get(); }

private:
    std::unique_ptr<CalibCamera, CameraDeleter> camera_;
};

} // namespace calib
