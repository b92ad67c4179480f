// Cameras that OpenCV reads, sent to `plumbline fly`: two of them, or one that delivers both images side by side.
//
//     c++ -std=c++17 -o fly_camera fly_camera.cpp $(pkg-config --cflags --libs plumbline opencv4)
//     ./fly_camera /tmp/frames 0 2        two devices; `./fly_camera /tmp/frames 0` for images side by side
//
// A camera is a number of a device, or what else OpenCV opens: a file, a pattern such as left_%03d.png, a pipeline. Stamps
// are those of the driver (V4L2), or else the times of arrival: where your camera's SDK reports the middle of the exposure, use that.
#include <algorithm>
#include <cctype>
#include <chrono>
#include <cstdint>
#include <iostream>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>
#include <plumbline.hpp>
#include <string>
#include <thread>
#include <vector>

namespace {

/// Period of frames that come from a file, which has no pace of its own.
constexpr std::chrono::milliseconds file_period(50);

bool is_number(const std::string &name) {
    return !name.empty() && std::all_of(name.begin(), name.end(), [](unsigned char c) { return std::isdigit(c) != 0; });
}

cv::VideoCapture opened(const std::string &name) {
    return is_number(name) ? cv::VideoCapture(std::stoi(name)) : cv::VideoCapture(name);
}

cv::Mat grey(const cv::Mat &image) {
    cv::Mat converted;
    if (image.channels() == 1) return image;
    cv::cvtColor(image, converted, cv::COLOR_BGR2GRAY);
    return converted;
}

/// Stamp of the frame that was grabbed, by CLOCK_MONOTONIC where the driver is one of V4L2.
std::int64_t driver_stamp_ns(const cv::VideoCapture &camera) {
    return static_cast<std::int64_t>(1e6 * camera.get(cv::CAP_PROP_POS_MSEC));
}

plumbline_image lent(const cv::Mat &image) {
    return plumbline::view(image.data, image.cols, image.rows, image.step);
}

}  // namespace

int main(int argc, char **argv) {
    if (argc != 3 && argc != 4) return std::cerr << "usage: fly_camera FRAME_SOCKET LEFT [RIGHT]\n", 2;
    std::vector<cv::VideoCapture> cameras;
    for (int k = 2; k < argc; k++) {
        cameras.push_back(opened(argv[k]));
        if (!cameras.back().isOpened()) return std::cerr << argv[k] << ": OpenCV opens no such camera\n", 1;
    }
    const bool is_file = !is_number(argv[2]);
    auto flight = plumbline::Frames::connect(argv[1], 30000);
    if (!flight) return std::cerr << flight.error().text << '\n', 1;
    std::vector<cv::Mat> images(cameras.size());
    for (plumbline::Frame frame{};; frame.sequence++) {
        // First both are taken, which is quick, then both are decoded.
        if (!std::all_of(cameras.begin(), cameras.end(), [](auto &camera) { return camera.grab(); })) break;
        const std::int64_t now_ns = plumbline::monotonic_ns(), late_ns = now_ns - driver_stamp_ns(cameras[0]);
        frame.stamp_ns = now_ns - (late_ns >= 0 && late_ns < 1000000000 ? late_ns : 0);
        for (std::size_t k = 0; k < cameras.size(); k++) cameras[k].retrieve(images[k]);
        cv::Mat left = grey(images[0]), right = grey(images.back());
        if (cameras.size() == 1) {
            right = left.colRange(left.cols / 2, left.cols);
            left = left.colRange(0, left.cols / 2);
        }
        // Halves are lent as they lie in the whole image: rows have gaps.
        frame.left = lent(left);
        frame.right = lent(right);
        if (const auto sent = flight->send(frame); !sent) return std::cerr << sent.error().text << '\n', 1;
        if (is_file) std::this_thread::sleep_for(file_period);
    }
}
