// Plumbline for C++17: a thin layer over plumbline.h. Handles free themselves, results are values, nothing throws.
#ifndef PLUMBLINE_HPP
#define PLUMBLINE_HPP

#include <plumbline.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <variant>

namespace plumbline {

using Estimate = plumbline_estimate;
using Frame = plumbline_frame;
using ImuAbout = plumbline_imu_about;
using ImuSample = plumbline_imu_sample;
using Odometry = plumbline_odometry;
using Record = plumbline_record;

/// Why a call failed.
struct Error {
    plumbline_status status = PLUMBLINE_STATUS_OK;
    std::string text;
};

/// A value, or why there is none. Ask which before the value is read.
template <class T>
class [[nodiscard]] Result {
public:
    Result(T value) : content_(std::in_place_index<0>, std::move(value)) {}
    Result(Error error) : content_(std::in_place_index<1>, std::move(error)) {}
    bool has_value() const noexcept { return content_.index() == 0; }
    explicit operator bool() const noexcept { return has_value(); }
    T &operator*() noexcept { return *std::get_if<0>(&content_); }
    const T &operator*() const noexcept { return *std::get_if<0>(&content_); }
    T *operator->() noexcept { return std::get_if<0>(&content_); }
    const T *operator->() const noexcept { return std::get_if<0>(&content_); }
    const Error &error() const noexcept { return *std::get_if<1>(&content_); }

private:
    std::variant<T, Error> content_;
};

/// Outcome of a call without a value.
using Done = Result<std::monostate>;

/// An 8-bit grey image that is lent: `stride` bytes from row to row, 0 for rows without gaps.
inline plumbline_image view(const std::uint8_t *pixels, int width, int height, std::size_t stride = 0) noexcept {
    const auto side = [](int length) { return static_cast<std::uint32_t>(length < 0 ? 0 : length); };
    return {pixels, side(width), side(height), stride == 0 ? static_cast<std::size_t>(side(width)) : stride};
}

/// An image that did not arrive.
inline constexpr plumbline_image missing{nullptr, 0, 0, 0};

/// View of a covariance as a 9 x 9 matrix: position, attitude, velocity.
class Covariance {
public:
    explicit Covariance(const Odometry &odometry) noexcept : upper_(odometry.covariance) {}
    explicit Covariance(const Estimate &estimate) noexcept : upper_(estimate.covariance) {}
    double operator()(int row, int column) const noexcept { return plumbline_covariance_at(upper_, row, column); }

private:
    const double *upper_;
};

/// Names of the health bits that are set.
inline std::string health_text(std::uint32_t health) {
    std::string text(plumbline_health_text(health, nullptr, 0), '\0');
    plumbline_health_text(health, text.data(), text.size() + 1);
    return text;
}

/// Time by CLOCK_MONOTONIC, ns: what frames and inertial samples of a flight are stamped by.
inline std::int64_t monotonic_ns() noexcept { return plumbline_monotonic_ns(); }

namespace detail {

template <class T, plumbline_status (*Free)(T *, plumbline_error *)>
struct Freer {
    void operator()(T *handle) const noexcept { Free(handle, nullptr); }
};

template <class T, plumbline_status (*Free)(T *, plumbline_error *)>
using Handle = std::unique_ptr<T, Freer<T, Free>>;

inline Error error_of(const plumbline_error &error) { return {error.status, error.text}; }

/// Calls `call` with a place for its error.
template <class Call>
Done done(Call call) {
    plumbline_error error;
    if (call(&error) < 0) return error_of(error);
    return std::monostate{};
}

/// Calls `call` with places for a result and its error; the result is missing where the call has none.
template <class T, class Call>
Result<std::optional<T>> maybe(Call call) {
    T value;
    plumbline_error error;
    const plumbline_status status = call(&value, &error);
    if (status < 0) return error_of(error);
    return status == PLUMBLINE_STATUS_OK ? std::optional<T>(value) : std::nullopt;
}

/// Makes an object of the handle that `call` writes.
template <class Object, class T, class Call>
Result<Object> made(Call call) {
    T *handle = nullptr;
    plumbline_error error;
    if (call(&handle, &error) < 0) return error_of(error);
    return Object(handle);
}

}  // namespace detail

/// The estimator of one vehicle.
class Estimator {
public:
    static Result<Estimator> from_toml(const std::string &text) {
        return detail::made<Estimator, plumbline_estimator>(
            [&](auto to, auto error) { return plumbline_estimator_from_toml(text.c_str(), to, error); });
    }
    static Result<Estimator> from_file(const std::string &path) {
        return detail::made<Estimator, plumbline_estimator>(
            [&](auto to, auto error) { return plumbline_estimator_from_file(path.c_str(), to, error); });
    }
    explicit Estimator(plumbline_estimator *handle) noexcept : handle_(handle) {}
    plumbline_estimator *get() const noexcept { return handle_.get(); }

    /// Adds an inertial sample; the state at its time, once there is a pose.
    Result<std::optional<Odometry>> add_imu(const ImuSample &sample) {
        return detail::maybe<Odometry>(
            [&](auto to, auto error) { return plumbline_estimator_add_imu(get(), &sample, to, error); });
    }
    /// Time up to which inertial samples have to be added before the frame of this stamp is, ns.
    Result<std::int64_t> imu_needed_until(std::int64_t image_stamp_ns) const {
        std::int64_t needed_ns = 0;
        plumbline_error error;
        const auto status = plumbline_estimator_imu_needed_until(get(), image_stamp_ns, &needed_ns, &error);
        if (status < 0) return detail::error_of(error);
        return needed_ns;
    }
    /// Adds a frame, and computes the estimate at its time; one whose `state` is initialising or failed has no pose.
    Result<Estimate> add_frame(const Frame &frame) {
        Estimate estimate;
        plumbline_error error;
        if (plumbline_estimator_add_frame(get(), &frame, &estimate, &error) < 0) return detail::error_of(error);
        return estimate;
    }
    /// Resets the estimator before the next frame.
    Done reset(plumbline_reset kind) {
        return detail::done([&](auto error) { return plumbline_estimator_reset(get(), kind, error); });
    }
    /// SHA-256 over the bits of all estimates so far.
    Result<std::string> digest() const {
        char text[65];
        plumbline_error error;
        if (plumbline_estimator_digest(get(), &text, &error) < 0) return detail::error_of(error);
        return std::string(text);
    }

private:
    detail::Handle<plumbline_estimator, plumbline_estimator_free> handle_;
};

/// Connection to the local socket of a flight.
class Local {
public:
    static Result<Local> connect(const std::string &path, std::uint32_t patience_ms) {
        return detail::made<Local, plumbline_local>([&](auto to, auto error) {
            return plumbline_local_connect(path.c_str(), patience_ms, to, error);
        });
    }
    explicit Local(plumbline_local *handle) noexcept : handle_(handle) {}
    plumbline_local *get() const noexcept { return handle_.get(); }

    /// Waits for the next record; none where the time is over, or the flight (`has_ended`).
    Result<std::optional<Record>> read(std::uint32_t timeout_ms) {
        return detail::maybe<Record>([&](auto to, auto error) {
            const plumbline_status status = plumbline_local_read(get(), timeout_ms, to, error);
            has_ended_ = has_ended_ || status == PLUMBLINE_STATUS_FLIGHT_ENDED;
            return status;
        });
    }
    bool has_ended() const noexcept { return has_ended_; }
    /// Resets the estimator of the flight before its next frame.
    Done reset(plumbline_reset kind, std::uint32_t timeout_ms) {
        return detail::done([&](auto error) { return plumbline_local_reset(get(), kind, timeout_ms, error); });
    }
    /// Saves the map of the flight; the number of keyframes that were saved.
    Result<std::uint32_t> save_map(std::uint32_t timeout_ms) {
        std::uint32_t keyframes = 0;
        plumbline_error error;
        if (plumbline_local_save_map(get(), timeout_ms, &keyframes, &error) < 0) return detail::error_of(error);
        return keyframes;
    }

private:
    detail::Handle<plumbline_local, plumbline_local_free> handle_;
    bool has_ended_ = false;
};

/// Connection that frames are sent over.
class Frames {
public:
    static Result<Frames> connect(const std::string &path, std::uint32_t patience_ms) {
        return detail::made<Frames, plumbline_frames>([&](auto to, auto error) {
            return plumbline_frames_connect(path.c_str(), patience_ms, to, error);
        });
    }
    explicit Frames(plumbline_frames *handle) noexcept : handle_(handle) {}
    plumbline_frames *get() const noexcept { return handle_.get(); }

    Done send(const Frame &frame) {
        return detail::done([&](auto error) { return plumbline_frames_send(get(), &frame, error); });
    }

private:
    detail::Handle<plumbline_frames, plumbline_frames_free> handle_;
};

/// Inertial sensor that a program plays to a flight.
class Imu {
public:
    static Result<Imu> open(const std::string &path, const ImuAbout &about) {
        return detail::made<Imu, plumbline_imu>(
            [&](auto to, auto error) { return plumbline_imu_open(path.c_str(), &about, to, error); });
    }
    explicit Imu(plumbline_imu *handle) noexcept : handle_(handle) {}
    plumbline_imu *get() const noexcept { return handle_.get(); }

    Done send(const ImuSample &sample) {
        return detail::done([&](auto error) { return plumbline_imu_send(get(), &sample, error); });
    }

private:
    detail::Handle<plumbline_imu, plumbline_imu_free> handle_;
};

}  // namespace plumbline

#endif  // PLUMBLINE_HPP
