/* Plumbline: the estimator of visual-inertial odometry, and the programs beside a flight. docs/c-library.md is the guide.
 *
 * Every function returns a status: 0 is done, above 0 done without a result, below 0 an error, whose text is written to the
 * last argument unless that is null. No function ends the program or lets an exception through. A handle is used by one
 * thread at a time: a second one gets PLUMBLINE_STATUS_BUSY. One that was freed is PLUMBLINE_STATUS_BAD_HANDLE.
 *
 * Frames: O is the odometry frame (z up, origin at the first pose), B the body, which is the IMU's.
 */

#ifndef PLUMBLINE_H
#define PLUMBLINE_H

/* Made by cbindgen of runtime/capi: do not edit. */

#include <stddef.h>
#include <stdint.h>
/* Element of the 9 x 9 covariance of odometry or an estimate: 0 to 2 position, 3 to 5 attitude, 6 to 8 velocity. */
static inline double plumbline_covariance_at(const double covariance[45], int row, int column) {
    const int first = row < column ? row : column, second = row < column ? column : row;
    return covariance[first * (17 - first) / 2 + second];
}

// Version of the binary interface that this header describes: the number in the library's soname. It changes with every
// change of a structure or of a function that a compiled program could not survive.
#define PLUMBLINE_ABI 0

// Outcome of a call: 0 done; above 0 done, and nothing to hand out; below 0 an error.
enum plumbline_status
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
  // Done.
  PLUMBLINE_STATUS_OK = 0,
  // Done; there is no pose yet.
  PLUMBLINE_STATUS_NO_POSE = 1,
  // No record came in time.
  PLUMBLINE_STATUS_TIMEOUT = 2,
  // The flight has ended.
  PLUMBLINE_STATUS_FLIGHT_ENDED = 3,
  // A pointer is null that may not be.
  PLUMBLINE_STATUS_NULL_POINTER = -1,
  // The handle was freed, is of another type, or never was one.
  PLUMBLINE_STATUS_BAD_HANDLE = -2,
  // Another thread uses the handle.
  PLUMBLINE_STATUS_BUSY = -3,
  // An earlier call failed within the library (PLUMBLINE_STATUS_PANIC): free the handle.
  PLUMBLINE_STATUS_POISONED = -4,
  // A fault of the library itself; please report it. The handle is poisoned.
  PLUMBLINE_STATUS_PANIC = -5,
  // An argument is out of range.
  PLUMBLINE_STATUS_BAD_ARGUMENT = -6,
  // The configuration cannot be read, or is refused.
  PLUMBLINE_STATUS_CONFIGURATION = -7,
  // An image has not the size of the configuration, or a stride shorter than its width.
  PLUMBLINE_STATUS_IMAGE_SIZE = -8,
  // A value is not a finite number; the sample was refused.
  PLUMBLINE_STATUS_NOT_FINITE = -9,
  // The stamp is not later than that of the sample or frame before; it was refused.
  PLUMBLINE_STATUS_OUT_OF_ORDER = -10,
  // The stamp is far later than that of the sample before; the sample was refused.
  PLUMBLINE_STATUS_FAR_AHEAD = -11,
  // A value is far beyond the sensor's range; the sample was refused.
  PLUMBLINE_STATUS_OUT_OF_RANGE = -12,
  // No flight listens at the path, or it may not be connected to.
  PLUMBLINE_STATUS_CONNECT = -13,
  // The flight has closed the connection, or takes nothing: free the handle, and connect again.
  PLUMBLINE_STATUS_DISCONNECTED = -14,
  // The other end is no flight of this version.
  PLUMBLINE_STATUS_FOREIGN = -15,
  // The flight has refused the command, or could not do it.
  PLUMBLINE_STATUS_REFUSED = -16,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum plumbline_status plumbline_status;
#else
typedef int32_t plumbline_status;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

// Kind of a record that plumbline_local_read hands out.
enum plumbline_record_kind
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
  // Number of records that this reader has lost so far, since it was slower than the flight.
  PLUMBLINE_RECORD_KIND_LOST = 2,
  // Odometry.
  PLUMBLINE_RECORD_KIND_ODOMETRY = 16,
  // Estimate.
  PLUMBLINE_RECORD_KIND_ESTIMATE = 17,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum plumbline_record_kind plumbline_record_kind;
#else
typedef uint32_t plumbline_record_kind;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

// State of the estimator.
enum plumbline_state
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint8_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
  // Gathering data; there is no pose yet.
  PLUMBLINE_STATE_INITIALISING = 0,
  // Estimating from images and IMU.
  PLUMBLINE_STATE_TRACKING = 1,
  // Estimating from the IMU alone.
  PLUMBLINE_STATE_BLIND = 2,
  // The estimate was given up; a new start is under way.
  PLUMBLINE_STATE_FAILED = 3,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum plumbline_state plumbline_state;
#else
typedef uint8_t plumbline_state;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

// Extent of a reset.
enum plumbline_reset
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
  // The map and the window go; the pose stays.
  PLUMBLINE_RESET_SOFT = 1,
  // Everything goes: the new start begins at the origin.
  PLUMBLINE_RESET_HARD = 2,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum plumbline_reset plumbline_reset;
#else
typedef uint32_t plumbline_reset;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

// The estimator of one vehicle.
typedef struct plumbline_estimator plumbline_estimator;

// Connection that frames are sent over.
typedef struct plumbline_frames plumbline_frames;

// Inertial sensor that a program plays to a flight.
typedef struct plumbline_imu plumbline_imu;

// Connection to the local socket of a flight.
typedef struct plumbline_local plumbline_local;

// Error of a call, in memory of the caller: the last argument of every function that can fail. It is written where the
// call fails, and may be null.
typedef struct plumbline_error {
  // Outcome of the call.
  plumbline_status status;
  // Failure, cause and cure: UTF-8, ends with a zero.
  char text[1020];
} plumbline_error;

// Inertial sample.
typedef struct plumbline_imu_sample {
  // Time of measurement, ns.
  int64_t stamp_ns;
  // Angular rate x y z of B, rad/s.
  double gyro_rad_s[3];
  // Specific force x y z in B, m/s^2 (at rest it points up, +9.81).
  double accel_m_s2[3];
} plumbline_imu_sample;

// State at an inertial sample (200 Hz): record 16 of the local socket.
typedef struct plumbline_odometry {
  // Time of the inertial sample, ns: CLOCK_MONOTONIC, or the clock of a recording.
  int64_t stamp_ns;
  // Time of the hand-over by the flight, ns since 1970; 0 from an estimator of one's own.
  int64_t handed_over_ns;
  // Counts odometry.
  uint64_t sequence;
  // Position of B in O, m.
  double position_m[3];
  // Rotation that takes coordinates from B to O: quaternion x y z w.
  double rotation_xyzw[4];
  // Velocity of B in O, m/s.
  double velocity_m_s[3];
  // Angular rate of B, bias removed, rad/s.
  double rate_rad_s[3];
  // Covariance of position, attitude and velocity: upper triangle of the 9 x 9 matrix by rows.
  double covariance[45];
  // Health bits of the newest estimate.
  uint32_t health;
  // Number of resets: where it changes, the pose may jump.
  uint32_t reset_counter;
  // Number of steps within the same odometry frame so far.
  uint32_t jumps;
  // State (plumbline_state): 0 initialising, 1 tracking, 2 blind, 3 failed; in 0 and 3 the pose is meaningless.
  uint8_t state;
  // Quality: -1 failed, else 0 to 100.
  int8_t quality;
  // Zero.
  uint8_t reserved[2];
} plumbline_odometry;

// 8-bit grey image that is lent for the time of a call.
typedef struct plumbline_image {
  // First pixel of the first row; null for an image that did not arrive.
  const uint8_t *pixels;
  // Width, px.
  uint32_t width;
  // Height, px.
  uint32_t height;
  // Bytes from the beginning of a row to that of the next, at least the width.
  size_t stride;
} plumbline_image;

// Stereo frame, or a frame of one camera.
typedef struct plumbline_frame {
  // Middle of the exposure, ns: by the camera's clock for an estimator, by CLOCK_MONOTONIC for a flight.
  int64_t stamp_ns;
  // Number of the frame as the camera counts.
  uint64_t sequence;
  // Left image, or that of the one camera.
  struct plumbline_image left;
  // Right image.
  struct plumbline_image right;
} plumbline_frame;

// Main part of the estimate after a frame: record 17 of the local socket.
typedef struct plumbline_estimate {
  // Time of the state on the IMU's time axis, ns.
  int64_t stamp_ns;
  // Time of the hand-over by the flight, ns since 1970; 0 from an estimator of one's own.
  int64_t handed_over_ns;
  // Number of the frame.
  uint64_t sequence;
  // Position of B in O, m.
  double position_m[3];
  // Rotation that takes coordinates from B to O: quaternion x y z w.
  double rotation_xyzw[4];
  // Velocity of B in O, m/s.
  double velocity_m_s[3];
  // Bias of the gyroscope, rad/s.
  double bias_gyro_rad_s[3];
  // Bias of the accelerometer, m/s^2.
  double bias_accel_m_s2[3];
  // Covariance of position, attitude and velocity: upper triangle of the 9 x 9 matrix by rows.
  double covariance[45];
  // Time offset of the camera, s: t_imu - t_camera.
  double time_offset_s;
  // Health bits.
  uint32_t health;
  // Number of resets: where it changes, the pose may jump.
  uint32_t reset_counter;
  // State (plumbline_state): 0 initialising, 1 tracking, 2 blind, 3 failed; in 0 and 3 the pose is meaningless.
  uint8_t state;
  // Quality: -1 failed, else 0 to 100.
  int8_t quality;
  // 1 if the frame is a keyframe.
  uint8_t is_keyframe;
  // Zero.
  uint8_t reserved[5];
} plumbline_estimate;

// Content of a record.
typedef union plumbline_record_content {
  // Number of lost records, where the kind is PLUMBLINE_RECORD_KIND_LOST.
  uint64_t lost;
  // Odometry, where the kind is PLUMBLINE_RECORD_KIND_ODOMETRY.
  struct plumbline_odometry odometry;
  // Estimate, where the kind is PLUMBLINE_RECORD_KIND_ESTIMATE.
  struct plumbline_estimate estimate;
} plumbline_record_content;

// Record of a flight.
typedef struct plumbline_record {
  // Kind of the content.
  plumbline_record_kind kind;
  // Content.
  union plumbline_record_content content;
} plumbline_record;

// State at an instant: record 27 of the local socket.
typedef struct plumbline_instant {
  // The instant, ns.
  int64_t stamp_ns;
  // Time of the hand-over by the flight, ns since 1970.
  int64_t handed_over_ns;
  // Number of the request, or of the trigger.
  uint64_t number;
  // Position of B in O, m.
  double position_m[3];
  // Rotation that takes coordinates from B to O: quaternion x y z w.
  double rotation_xyzw[4];
  // Velocity of B in O, m/s.
  double velocity_m_s[3];
  // Angular rate of B, bias removed, rad/s.
  double rate_rad_s[3];
  // Covariance of position, attitude and velocity: upper triangle of the 9 x 9 matrix by rows.
  double covariance[45];
  // Time of the estimate before the instant, ns.
  int64_t estimated_ns;
  // Number of resets until then.
  uint32_t reset_counter;
  // State (plumbline_state).
  uint8_t state;
  // Quality: 0 to 100.
  int8_t quality;
  // Outcome: 0 answered, 1 there was no pose then, 2 longer ago than 3 s, 3 later than the newest inertial sample; the state
  // counts only for 0.
  uint8_t outcome;
  // 1 if there is an estimate after the instant too: the answer would not change any more.
  uint8_t is_settled;
  // Source: 0 a request, 1 a trigger of the autopilot, 2 a list (replay --at).
  uint8_t source;
  // Zero.
  uint8_t reserved[7];
} plumbline_instant;

// Inertial sensor: rate and ranges by section `imu` of the configuration of the flight.
typedef struct plumbline_imu_about {
  // Samples a second.
  double rate_hz;
  // Largest angular rate, rad/s.
  double gyro_range_rad_s;
  // Largest specific force, m/s^2.
  double accel_range_m_s2;
} plumbline_imu_about;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// Returns the version of the binary interface of the loaded library. A program that loads it by dlopen compares it with
// PLUMBLINE_ABI.
uint32_t plumbline_abi(void);

// Returns the version of the library, such as "0.1.0".
const char *plumbline_version(void);

// Makes an estimator by a configuration in TOML. Free it with plumbline_estimator_free.
plumbline_status plumbline_estimator_from_toml(const char *text,
                                               struct plumbline_estimator **estimator,
                                               struct plumbline_error *error);

// Makes an estimator by a configuration file. Free it with plumbline_estimator_free.
plumbline_status plumbline_estimator_from_file(const char *path,
                                               struct plumbline_estimator **estimator,
                                               struct plumbline_error *error);

// Frees an estimator.
plumbline_status plumbline_estimator_free(struct plumbline_estimator *estimator, struct plumbline_error *error);

// Adds an inertial sample, in order of time, and carries the newest estimate forward to its time. `odometry` may be null;
// it is written where PLUMBLINE_STATUS_OK is returned, and PLUMBLINE_STATUS_NO_POSE is while there is no pose.
plumbline_status plumbline_estimator_add_imu(struct plumbline_estimator *estimator,
                                             const struct plumbline_imu_sample *sample,
                                             struct plumbline_odometry *odometry,
                                             struct plumbline_error *error);

// Writes the time up to which inertial samples have to be added before the frame of `image_stamp_ns` is.
plumbline_status plumbline_estimator_imu_needed_until(struct plumbline_estimator *estimator,
                                                      int64_t image_stamp_ns,
                                                      int64_t *needed_ns,
                                                      struct plumbline_error *error);

// Adds a frame, whose images are lent for the time of the call and not copied, and computes the estimate at its time.
// `estimate` may be null; it is written unless an argument is refused. PLUMBLINE_STATUS_NO_POSE is returned while there
// is no pose.
plumbline_status plumbline_estimator_add_frame(struct plumbline_estimator *estimator,
                                               const struct plumbline_frame *frame,
                                               struct plumbline_estimate *estimate,
                                               struct plumbline_error *error);

// Resets the estimator before the next frame; `kind` is a plumbline_reset.
plumbline_status plumbline_estimator_reset(struct plumbline_estimator *estimator,
                                           uint32_t kind,
                                           struct plumbline_error *error);

// Writes the SHA-256 over the bits of all estimates so far, in hexadecimal, into 65 bytes at `digest`: the
// `estimate_digest` of `plumbline replay` for the same configuration and samples.
plumbline_status plumbline_estimator_digest(struct plumbline_estimator *estimator,
                                            char (*digest)[65],
                                            struct plumbline_error *error);

// Returns the time by CLOCK_MONOTONIC, ns: what frames and inertial samples of a flight are stamped by.
int64_t plumbline_monotonic_ns(void);

// Connects to the local socket of a flight (local.path), which may come into being within `patience_ms`. Free the
// connection with plumbline_local_free.
plumbline_status plumbline_local_connect(const char *path,
                                         uint32_t patience_ms,
                                         struct plumbline_local **local,
                                         struct plumbline_error *error);

// Frees a connection to the local socket.
plumbline_status plumbline_local_free(struct plumbline_local *local, struct plumbline_error *error);

// Waits for the next odometry, estimate or count of losses. Returns PLUMBLINE_STATUS_TIMEOUT when none came within
// `timeout_ms`, and PLUMBLINE_STATUS_FLIGHT_ENDED at the end of the flight.
plumbline_status plumbline_local_read(struct plumbline_local *local,
                                      uint32_t timeout_ms,
                                      struct plumbline_record *record,
                                      struct plumbline_error *error);

// Writes the state at the instant `stamp_ns` of the last three seconds, such as that of a camera's trigger, by the clock of the
// odometry. The flight waits at most `patience_ms`, up to 2000, for its inertial samples to reach the instant; where
// `settled` is not 0, for the estimate after it too. Returns PLUMBLINE_STATUS_NO_POSE where there is no state: outcome says
// why. Records go on coming.
plumbline_status plumbline_local_at(struct plumbline_local *local,
                                    int64_t stamp_ns,
                                    uint32_t patience_ms,
                                    uint32_t settled,
                                    struct plumbline_instant *instant,
                                    struct plumbline_error *error);

// Resets the estimator of the flight before its next frame; `kind` is a plumbline_reset. Records go on coming.
plumbline_status plumbline_local_reset(struct plumbline_local *local,
                                       uint32_t kind,
                                       uint32_t timeout_ms,
                                       struct plumbline_error *error);

// Saves the map of the flight to the file of `--save-map`. `keyframes` may be null; else the number of keyframes that
// were saved is written there.
plumbline_status plumbline_local_save_map(struct plumbline_local *local,
                                          uint32_t timeout_ms,
                                          uint32_t *keyframes,
                                          struct plumbline_error *error);

// Connects to the frame socket of a flight (driver.frames.listen), which may come into being within `patience_ms`. Free
// the connection with plumbline_frames_free.
plumbline_status plumbline_frames_connect(const char *path,
                                          uint32_t patience_ms,
                                          struct plumbline_frames **frames,
                                          struct plumbline_error *error);

// Frees a connection to the frame socket.
plumbline_status plumbline_frames_free(struct plumbline_frames *frames, struct plumbline_error *error);

// Sends a frame to the flight. Images have to have the sizes of its configuration: else it disconnects, and its log says
// why.
plumbline_status plumbline_frames_send(struct plumbline_frames *frames,
                                       const struct plumbline_frame *frame,
                                       struct plumbline_error *error);

// Makes a line for an inertial sensor, and a symbolic link `path` to it: driver.imu.connect of the flight is
// serial://PATH:921600, and its protocol is plumbline. A thread of the library answers what the flight asks. Free the
// line with plumbline_imu_free.
plumbline_status plumbline_imu_open(const char *path,
                                    const struct plumbline_imu_about *about,
                                    struct plumbline_imu **imu,
                                    struct plumbline_error *error);

// Frees the line of an inertial sensor, and removes its link.
plumbline_status plumbline_imu_free(struct plumbline_imu *imu, struct plumbline_error *error);

// Sends an inertial sample, as soon as it was measured. One that no flight reads is dropped.
plumbline_status plumbline_imu_send(struct plumbline_imu *imu,
                                    const struct plumbline_imu_sample *sample,
                                    struct plumbline_error *error);

// Returns the name of a plumbline_state, such as "tracking"; null for a number that is none.
const char *plumbline_state_name(uint8_t state);

// Returns the name of health bit number `bit`, from 0, such as "few features"; null for a bit that has none.
const char *plumbline_health_name(uint32_t bit);

// Writes the names of all health bits that are set, with commas between them, into `size` bytes at `text`, and returns the
// length of the whole text: it was cut where that is not less than `size`.
size_t plumbline_health_text(uint32_t health,
                             char *text,
                             size_t size);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* PLUMBLINE_H */
