// Maps boxes of a detector to metres with the C++ class: boxes_to_floor SITE.json CAMERA

#include <cstdio>
#include <exception>
#include <fstream>
#include <iostream>
#include <iterator>

#include "camera.hpp"

int main(int argc, char **argv)
try {
    if (argc != 3) {
        std::cerr << "usage: boxes_to_floor SITE.json CAMERA\n";
        return 2;
    }
    std::ifstream file(argv[1], std::ios::binary);
    const calib::Site site = calib::parse({std::istreambuf_iterator<char>(file), {}});
    // The detector's stream has 1280 x 720 pixels.
    CalibStream stream{};
    stream.width = 1280;
    stream.height = 720;
    const calib::Camera camera(site, argv[2], stream);
    // Left, top, right, bottom.
    const calib::Floor floor = camera.boxes_to_floor(CALIB_BOX_CORNERS, {600, 300, 640, 470, 200, 330, 250, 600});
    for (std::size_t i = 0; i < floor.x.size(); i++) {
        std::printf("%.3f m, %.3f m: %s\n", floor.x[i], floor.y[i], calib_status_name(floor.status[i]));
    }
} catch (const std::exception &error) {
    std::cerr << error.what() << '\n';
    return 1;
}
