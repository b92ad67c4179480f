// Flies a EuRoC folder through the estimator; images are read by OpenCV.
//
//     c++ -std=c++17 -o replay_euroc replay_euroc.cpp $(pkg-config --cflags --libs plumbline opencv4)
//     ./replay_euroc euroc.toml V1_01_easy
#include <fstream>
#include <iostream>
#include <limits>
#include <opencv2/imgcodecs.hpp>
#include <plumbline.hpp>
#include <sstream>
#include <string>

namespace {

/// The next row of a table of numbers and names, with blanks for its commas; none at its end.
bool next_row(std::istream &table, std::istringstream &row) {
    std::string line;
    while (std::getline(table, line)) {
        if (line.empty() || line[0] == '#') continue;
        for (char &sign : line) sign = sign == ',' || sign == '\r' ? ' ' : sign;
        row.clear();
        row.str(line);
        return true;
    }
    return false;
}

cv::Mat image(const std::string &folder, int camera, const std::string &name) {
    return cv::imread(folder + "/mav0/cam" + std::to_string(camera) + "/data/" + name, cv::IMREAD_GRAYSCALE);
}

plumbline_image lent(const cv::Mat &image) {
    return image.empty() ? plumbline::missing : plumbline::view(image.data, image.cols, image.rows, image.step);
}

int fail(const plumbline::Error &error) {
    std::cerr << error.text << '\n';
    return 1;
}

}  // namespace

int main(int argc, char **argv) {
    if (argc != 3) return std::cerr << "usage: replay_euroc CONFIG.toml FOLDER\n", 2;
    const std::string folder = argv[2];
    auto estimator = plumbline::Estimator::from_file(argv[1]);
    if (!estimator) return fail(estimator.error());
    std::ifstream imu(folder + "/mav0/imu0/data.csv"), camera(folder + "/mav0/cam0/data.csv");
    std::istringstream row;
    plumbline::ImuSample sample{std::numeric_limits<std::int64_t>::min(), {}, {}};
    for (plumbline::Frame frame{}; next_row(camera, row); frame.sequence++) {
        std::string name;
        row >> frame.stamp_ns >> name;
        const auto needed_ns = estimator->imu_needed_until(frame.stamp_ns);
        while (needed_ns && sample.stamp_ns < *needed_ns && next_row(imu, row)) {
            row >> sample.stamp_ns;
            for (double &value : sample.gyro_rad_s) row >> value;
            for (double &value : sample.accel_m_s2) row >> value;
            if (const auto state = estimator->add_imu(sample); !state) fail(state.error());
        }
        const cv::Mat left = image(folder, 0, name), right = image(folder, 1, name);
        frame.left = lent(left);
        frame.right = lent(right);
        const auto estimate = estimator->add_frame(frame);
        if (!estimate) {
            fail(estimate.error());
        } else if (estimate->state == PLUMBLINE_STATE_TRACKING) {
            const plumbline::Covariance covariance(*estimate);
            const double *p = estimate->position_m;
            std::cout << estimate->stamp_ns << ' ' << p[0] << ' ' << p[1] << ' ' << p[2] << ' ' << covariance(2, 2) << '\n';
        }
    }
    const auto digest = estimator->digest();
    if (!digest) return fail(digest.error());
    std::cout << "digest " << *digest << '\n';
}
