// Checks that results are bit-identical to Rust, for every point of every camera, from two threads: golden FOLDER

#include <atomic>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <iostream>
#include <iterator>
#include <sstream>
#include <thread>

#include "../examples/camera.hpp"

namespace {

constexpr std::size_t POINTS = 5000, COLUMNS = 21;
constexpr double SIGMA_PX = 1.5;

std::atomic<int> wrong{0};

void same(const char *what, const double *expected, double found)
{
    const bool both_nan = *expected != *expected && found != found;
    if (!both_nan && std::memcmp(expected, &found, sizeof found) != 0 && wrong++ < 10) {
        std::fprintf(stderr, "%s: found %.17g, expected %.17g\n", what, found, *expected);
    }
}

std::string contents(const std::string &path)
{
    std::ifstream file(path, std::ios::binary);
    if (!file) {
        throw std::runtime_error(path + " cannot be read");
    }
    return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

void check(const calib::Camera &camera, double height, const double *columns)
{
    const auto column = [columns](std::size_t index) { return columns + index * POINTS; };
    const std::vector<double> u(column(0), column(1)), v(column(1), column(2));
    const calib::Floor floor = camera.to_floor(u, v, height);
    std::vector<double> noise(4 * POINTS), calibration(4 * POINTS), back_u(POINTS), back_v(POINTS), rays(3 * POINTS),
        straight_u(POINTS), straight_v(POINTS);
    const std::vector<double> z(POINTS, height);
    std::vector<std::uint8_t> back(POINTS);
    const CalibCamera *handle = camera.handle();
    calib::expect(calib_camera_floor_covariance(handle, height, SIGMA_PX, POINTS, u.data(), v.data(), noise.data(),
                                                calibration.data()));
    calib::expect(calib_camera_to_pixel(handle, POINTS, column(2), column(3), z.data(), back_u.data(), back_v.data(),
                                        back.data()));
    calib::expect(calib_camera_rays(handle, POINTS, u.data(), v.data(), rays.data()));
    calib::expect(calib_camera_undistort(handle, POINTS, u.data(), v.data(), straight_u.data(), straight_v.data()));
    for (std::size_t i = 0; i < POINTS; i++) {
        same("x", column(2) + i, floor.x[i]);
        same("y", column(3) + i, floor.y[i]);
        same("status", column(4) + i, floor.status[i]);
        for (std::size_t k = 0; k < 4; k++) {
            same("noise", column(5 + k) + i, noise[4 * i + k]);
            same("calibration", column(9 + k) + i, calibration[4 * i + k]);
        }
        same("u", column(13) + i, back_u[i]);
        same("v", column(14) + i, back_v[i]);
        same("status of the point", column(15) + i, back[i]);
        for (std::size_t k = 0; k < 3; k++) {
            same("ray", column(16 + k) + i, rays[3 * i + k]);
        }
        same("undistorted u", column(19) + i, straight_u[i]);
        same("undistorted v", column(20) + i, straight_v[i]);
    }
}

} // namespace

int main(int argc, char **argv)
try {
    if (argc != 2) {
        std::cerr << "usage: golden FOLDER\n";
        return 2;
    }
    const std::string folder = argv[1];
    const calib::Site site = calib::parse(contents(folder + "/site.json"));
    const std::string bytes = contents(folder + "/points.f64");
    std::vector<double> points(bytes.size() / sizeof(double));
    std::memcpy(points.data(), bytes.data(), points.size() * sizeof(double));
    std::istringstream lines(contents(folder + "/cameras.txt"));
    std::string line;
    std::size_t cameras = 0;
    while (std::getline(lines, line)) {
        std::istringstream fields(line);
        std::string id;
        CalibStream stream{};
        double height = 0.0;
        fields >> id >> stream.origin >> stream.fit >> stream.width >> stream.height >> stream.crop[0] >>
            stream.crop[1] >> stream.crop[2] >> stream.crop[3] >> height;
        const double *columns = points.data() + cameras++ * COLUMNS * POINTS;
        if (!fields || columns + COLUMNS * POINTS > points.data() + points.size()) {
            throw std::runtime_error("the golden files are inconsistent");
        }
        const calib::Camera camera(site, id, stream);
        std::thread other(check, std::cref(camera), height, columns);
        check(camera, height, columns);
        other.join();
    }
    std::printf("%zu points of %zu cameras, %d mismatches\n", cameras * POINTS, cameras, wrong.load());
    return cameras == 20 && wrong == 0 ? 0 : 1;
} catch (const std::exception &error) {
    std::cerr << error.what() << '\n';
    return 1;
}
