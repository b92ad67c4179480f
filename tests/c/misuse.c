/* Every misuse of the C library is an error value, with a text: misuse CONFIG.toml FOLDER [no-terminals]. Prints each
 * with its status, as docs/c-library.md groups them; ends with 1 where a value is another. */
#define _POSIX_C_SOURCE 200809L
#include <math.h>
#include <plumbline.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

enum { WIDTH = 752, HEIGHT = 480 };

static uint8_t pixels[WIDTH * HEIGHT];
static int failures;

#define EXPECT(what, name, call)                                       \
    do {                                                               \
        plumbline_error error = {.status = PLUMBLINE_STATUS_OK};       \
        check(what, #name, PLUMBLINE_STATUS_##name, call, &error);     \
    } while (0)

static void check(const char *what, const char *name, plumbline_status expected, plumbline_status got,
                  const plumbline_error *error) {
    const int has_text = got >= 0 || (error->status == got && error->text[0] != '\0');
    if (expected < 0) printf("| %s | `%s` |\n", what, name);
    if (got == expected && has_text) return;
    fprintf(stderr, "%s: %d in place of %d; text: %s\n", what, (int)got, (int)expected, error->text);
    failures++;
}

static plumbline_frame frame_at(int64_t stamp_ns) {
    const plumbline_image image = {pixels, WIDTH, HEIGHT, WIDTH};
    return (plumbline_frame){.stamp_ns = stamp_ns, .sequence = (uint64_t)(stamp_ns / 50000000), .left = image, .right = image};
}

static void of_creation(const char *config) {
    plumbline_estimator *estimator = NULL;
    EXPECT("no place for the handle", NULL_POINTER, plumbline_estimator_from_file(config, NULL, &error));
    EXPECT("no path", NULL_POINTER, plumbline_estimator_from_file(NULL, &estimator, &error));
    EXPECT("a file that is not there", CONFIGURATION, plumbline_estimator_from_file("/no/such.toml", &estimator, &error));
    EXPECT("a text that is not TOML", CONFIGURATION, plumbline_estimator_from_toml("[camera", &estimator, &error));
    EXPECT("a text that is not UTF-8", BAD_ARGUMENT, plumbline_estimator_from_toml("\xff\xfe", &estimator, &error));
    EXPECT("an empty configuration", CONFIGURATION, plumbline_estimator_from_toml("", &estimator, &error));
}

static void of_handles(const char *config) {
    plumbline_estimator *estimator = NULL;
    char digest[65];
    plumbline_estimator_from_file(config, &estimator, NULL);
    EXPECT("no handle", NULL_POINTER, plumbline_estimator_digest(NULL, &digest, &error));
    EXPECT("a handle that never was one", BAD_HANDLE,
           plumbline_estimator_digest((plumbline_estimator *)(void *)&digest, &digest, &error));
    EXPECT("a handle of another type", BAD_HANDLE, plumbline_frames_free((plumbline_frames *)(void *)estimator, &error));
    EXPECT("the handle", OK, plumbline_estimator_free(estimator, &error));
    EXPECT("a handle that was freed", BAD_HANDLE, plumbline_estimator_digest(estimator, &digest, &error));
    EXPECT("a handle that is freed twice", BAD_HANDLE, plumbline_estimator_free(estimator, &error));
    if (plumbline_estimator_free(estimator, NULL) != PLUMBLINE_STATUS_BAD_HANDLE) failures++;
}

static void of_samples(plumbline_estimator *estimator) {
    plumbline_imu_sample s = {.stamp_ns = 1000000000, .accel_m_s2 = {0, 0, 9.81}};
    plumbline_odometry odometry;
    EXPECT("no sample", NULL_POINTER, plumbline_estimator_add_imu(estimator, NULL, &odometry, &error));
    EXPECT("a sample before the first pose", NO_POSE, plumbline_estimator_add_imu(estimator, &s, &odometry, &error));
    EXPECT("a sample again", OUT_OF_ORDER, plumbline_estimator_add_imu(estimator, &s, &odometry, &error));
    s.stamp_ns -= 5000000;
    EXPECT("a sample from before", OUT_OF_ORDER, plumbline_estimator_add_imu(estimator, &s, &odometry, &error));
    s.stamp_ns = 1005000000;
    s.gyro_rad_s[1] = NAN;
    EXPECT("a sample that is not a number", NOT_FINITE, plumbline_estimator_add_imu(estimator, &s, &odometry, &error));
    s.gyro_rad_s[1] = 0;
    s.accel_m_s2[0] = INFINITY;
    EXPECT("a sample that is infinite", NOT_FINITE, plumbline_estimator_add_imu(estimator, &s, &odometry, &error));
    s.accel_m_s2[0] = 1e9;
    EXPECT("a sample beyond the sensor's range", OUT_OF_RANGE, plumbline_estimator_add_imu(estimator, &s, &odometry, &error));
    s.accel_m_s2[0] = 0;
    s.stamp_ns = INT64_MAX;
    EXPECT("a sample of another clock", FAR_AHEAD, plumbline_estimator_add_imu(estimator, &s, &odometry, &error));
    EXPECT("no place for the time", NULL_POINTER, plumbline_estimator_imu_needed_until(estimator, 0, NULL, &error));
    EXPECT("a reset of no kind", BAD_ARGUMENT, plumbline_estimator_reset(estimator, 3, &error));
    EXPECT("no place for the digest", NULL_POINTER, plumbline_estimator_digest(estimator, NULL, &error));
}

static void of_frames(plumbline_estimator *estimator) {
    plumbline_estimate e;
    plumbline_frame frame = frame_at(1000000000);
    EXPECT("no frame", NULL_POINTER, plumbline_estimator_add_frame(estimator, NULL, &e, &error));
    frame.left.width--;
    EXPECT("an image of another width", IMAGE_SIZE, plumbline_estimator_add_frame(estimator, &frame, &e, &error));
    frame = frame_at(1000000000);
    frame.right.height = 0;
    EXPECT("an image without rows", IMAGE_SIZE, plumbline_estimator_add_frame(estimator, &frame, &e, &error));
    frame = frame_at(1000000000);
    frame.right.stride = WIDTH - 1;
    EXPECT("a stride shorter than the width", IMAGE_SIZE, plumbline_estimator_add_frame(estimator, &frame, &e, &error));
    frame.right.stride = SIZE_MAX;
    EXPECT("a stride longer than memory", IMAGE_SIZE, plumbline_estimator_add_frame(estimator, &frame, &e, &error));
    frame = frame_at(1000000000);
    EXPECT("a frame before the first pose", NO_POSE, plumbline_estimator_add_frame(estimator, &frame, &e, &error));
    EXPECT("a frame again", OUT_OF_ORDER, plumbline_estimator_add_frame(estimator, &frame, &e, &error));
    frame = (plumbline_frame){.stamp_ns = 1050000000, .sequence = 21};
    EXPECT("a frame without images", NO_POSE, plumbline_estimator_add_frame(estimator, &frame, NULL, &error));
}

static plumbline_estimator *shared;
static int is_over;

static void *add_frames(void *unused) {
    for (int64_t stamp = 2000000000; !__atomic_load_n(&is_over, __ATOMIC_SEQ_CST); stamp += 50000000) {
        plumbline_frame frame = frame_at(stamp);
        plumbline_estimator_add_frame(shared, &frame, NULL, NULL);
    }
    return unused;
}

static void of_threads(void) {
    pthread_t thread;
    char digest[65];
    plumbline_status status = PLUMBLINE_STATUS_OK;
    plumbline_error error = {.status = PLUMBLINE_STATUS_OK};
    if (pthread_create(&thread, NULL, add_frames, NULL) != 0) exit((perror("thread"), 1));
    for (long k = 0; k < 10000000 && status == PLUMBLINE_STATUS_OK; k++)
        status = plumbline_estimator_digest(shared, &digest, &error);
    __atomic_store_n(&is_over, 1, __ATOMIC_SEQ_CST);
    pthread_join(thread, NULL);
    check("a handle in two threads at once", "BUSY", PLUMBLINE_STATUS_BUSY, status, &error);
    EXPECT("the same handle afterwards", OK, plumbline_estimator_digest(shared, &digest, &error));
}

/* A socket that listens at FOLDER/NAME. */
static int listen_at(const char *folder, const char *name, char *path, size_t size) {
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    const int listener = socket(AF_UNIX, SOCK_STREAM, 0);
    if (snprintf(path, size, "%s/%s", folder, name) >= (int)sizeof address.sun_path) exit((perror(path), 1));
    memcpy(address.sun_path, path, strlen(path) + 1);
    if (bind(listener, (struct sockaddr *)&address, sizeof address) || listen(listener, 4)) exit((perror(path), 1));
    return listener;
}

struct words { int listener; const char *text; size_t length; };

static void *write_words(void *of) {
    struct words *words = of;
    const int peer = accept(words->listener, NULL, NULL);
    if (write(peer, words->text, words->length) != (ssize_t)words->length) perror("write");
    close(peer);
    free(words);
    return NULL;
}

/* A thread that sends a text to the next that connects, and disconnects it. */
static int accept_and_write(int listener, const char *text, size_t length, pthread_t *thread) {
    struct words *words = malloc(sizeof *words);
    *words = (struct words){listener, text, length};
    return pthread_create(thread, NULL, write_words, words);
}

static void of_flights(const char *folder) {
    plumbline_local *local = NULL;
    plumbline_frames *frames = NULL;
    plumbline_record record;
    plumbline_frame frame = frame_at(1000000000);
    char path[108];
    EXPECT("a path without a flight", CONNECT, plumbline_local_connect("/no/such/socket", 0, &local, &error));
    EXPECT("a connection that is none", NULL_POINTER, plumbline_local_read(NULL, 0, &record, &error));

    int listener = listen_at(folder, "foreign", path, sizeof path);
    pthread_t thread;
    accept_and_write(listener, "HTTP/1.0 400 Bad Request", 24, &thread);
    EXPECT("a socket of another program", FOREIGN, plumbline_local_connect(path, 0, &local, &error));
    pthread_join(thread, NULL);
    close(listener);

    listener = listen_at(folder, "local", path, sizeof path);
    accept_and_write(listener, "\1\0\1\0\20\0\0\0\0\0\0\0\0\0\0\0PLMBLCL1\0\0\0\0\0\0\0\0", 32, &thread);
    EXPECT("a flight that says nothing but its greeting", OK, plumbline_local_connect(path, 0, &local, &error));
    pthread_join(thread, NULL);
    EXPECT("no place for the record", NULL_POINTER, plumbline_local_read(local, 0, NULL, &error));
    EXPECT("a flight that has closed the connection", DISCONNECTED, plumbline_local_read(local, 1000, &record, &error));
    close(listener);
    EXPECT("its handle", OK, plumbline_local_free(local, &error));

    listener = listen_at(folder, "frames", path, sizeof path);
    EXPECT("a flight that takes frames", OK, plumbline_frames_connect(path, 0, &frames, &error));
    frame.left.pixels = frame.right.pixels = NULL;
    EXPECT("a frame without images to a flight", BAD_ARGUMENT, plumbline_frames_send(frames, &frame, &error));
    frame = frame_at(1000000000);
    close(accept(listener, NULL, NULL));
    EXPECT("a frame to a flight that has gone, and no SIGPIPE", DISCONNECTED, plumbline_frames_send(frames, &frame, &error));
    EXPECT("a frame after that", DISCONNECTED, plumbline_frames_send(frames, &frame, &error));
    EXPECT("its handle", OK, plumbline_frames_free(frames, &error));
    close(listener);
}

static void of_sensors(const char *folder) {
    plumbline_imu *imu = NULL;
    plumbline_imu_about about = {.rate_hz = 0, .gyro_range_rad_s = 17, .accel_range_m_s2 = 157};
    plumbline_imu_sample s = {.stamp_ns = 1, .gyro_rad_s = {NAN, 0, 0}};
    char path[256];
    snprintf(path, sizeof path, "%s/imu", folder);
    EXPECT("a sensor without a rate", BAD_ARGUMENT, plumbline_imu_open(path, &about, &imu, &error));
    about.rate_hz = 200;
    EXPECT("a line in a folder that is not there", CONNECT, plumbline_imu_open("/no/such/imu", &about, &imu, &error));
    EXPECT("a line", OK, plumbline_imu_open(path, &about, &imu, &error));
    EXPECT("a sample that is not a number, to a flight", NOT_FINITE, plumbline_imu_send(imu, &s, &error));
    EXPECT("its handle", OK, plumbline_imu_free(imu, &error));
}

int main(int argc, char **argv) {
    if (argc < 3 || plumbline_abi() != PLUMBLINE_ABI) return 2;
    of_creation(argv[1]);
    of_handles(argv[1]);
    if (plumbline_estimator_from_file(argv[1], &shared, NULL) != PLUMBLINE_STATUS_OK) return 2;
    of_samples(shared);
    of_frames(shared);
    of_threads();
    plumbline_estimator_free(shared, NULL);
    of_flights(argv[2]);
    /* An emulator may know no pseudo-terminals. */
    if (argc == 3) of_sensors(argv[2]);
    if (plumbline_state_name(9) != NULL || plumbline_health_name(31) != NULL) failures++;
    char text[8];
    if (plumbline_health_text(UINT32_MAX, text, sizeof text) < 100 || strlen(text) != 7) failures++;
    return failures != 0;
}
