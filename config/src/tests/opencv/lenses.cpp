// Reference values of the lens models that OpenCV has: writes lenses.csv, which the tests of the lenses read.
//
//   g++ -O1 lenses.cpp -o lenses $(pkg-config --cflags --libs opencv4) && ./lenses > lenses.csv
//
// Made with OpenCV 4.6.0 and its contrib module ccalib. A row is: model, fx, fy, cx, cy, coefficients in our order, the point
// in the camera frame (m) after a `;`, and the pixel after another.
#include <cstdint>
#include <cstdio>
#include <string>
#include <vector>
#include <opencv2/calib3d.hpp>
#include <opencv2/ccalib/omnidir.hpp>

static uint64_t state = 47;

// Uniform between two numbers, the same with every compiler.
static double draw(double low, double high) {
    state = state * 6364136223846793005ULL + 1442695040888963407ULL;
    return low + (high - low) * static_cast<double>(state >> 11) / 9007199254740992.0;
}

static void row(const char *model, const cv::Matx33d &k, const std::vector<double> &c, cv::Vec3d p, cv::Vec2d px) {
    std::printf("%s,%.17g,%.17g,%.17g,%.17g", model, k(0, 0), k(1, 1), k(0, 2), k(1, 2));
    for (double value : c) std::printf(",%.17g", value);
    std::printf(";%.17g,%.17g,%.17g;%.17g,%.17g\n", p[0], p[1], p[2], px[0], px[1]);
}

int main() {
    const cv::Vec3d zero(0, 0, 0);
    for (int i = 0; i < 250; ++i) {
        const cv::Matx33d k(draw(200, 900), 0, draw(300, 340), 0, draw(200, 900), draw(220, 260), 0, 0, 1);
        const double z = draw(0.3, 20);
        const std::vector<cv::Vec3d> near = {{draw(-0.7, 0.7) * z, draw(-0.7, 0.7) * z, z}};
        const std::vector<cv::Vec3d> wide = {{draw(-3, 3) * z, draw(-3, 3) * z, z}};
        std::vector<cv::Vec2d> px;

        const std::vector<double> radtan = {draw(-0.3, 0.05), draw(0, 0.1), draw(-2e-3, 2e-3), draw(-2e-3, 2e-3)};
        cv::projectPoints(near, zero, zero, k, radtan, px);
        row("radial-tangential", k, radtan, near[0], px[0]);

        const double t = draw(0, 8);  // Numerator and denominator nearly cancel, as calibrations have it.
        const std::vector<double> rational = {t + draw(-0.3, 0), 0.5 * t + draw(-0.1, 0.1), draw(-2e-3, 2e-3),
            draw(-2e-3, 2e-3), draw(0, 0.1), t + draw(0, 0.2), 0.5 * t + draw(0, 0.2), draw(0, 0.1)};
        cv::projectPoints(near, zero, zero, k, rational, px);
        row("rational", k, rational, near[0], px[0]);

        const std::vector<double> fisheye = {draw(-0.05, 0.05), draw(-0.02, 0.02), draw(-0.01, 0.01), draw(-2e-3, 2e-3)};
        cv::fisheye::projectPoints(wide, px, zero, zero, k, fisheye);
        row("equidistant", k, fisheye, wide[0], px[0]);

        const double xi = draw(0, 3);
        const std::vector<double> d = {draw(-0.2, 0.05), draw(0, 0.05), draw(-2e-3, 2e-3), draw(-2e-3, 2e-3)};
        cv::omnidir::projectPoints(wide, px, zero, zero, k, xi, cv::Mat(d).reshape(1, 1));
        row("omni", k, {xi, d[0], d[1], d[2], d[3]}, wide[0], px[0]);
    }
}
