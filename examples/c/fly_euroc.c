/* Plays a EuRoC folder to `plumbline fly` in real time: IMU and cameras that a program of one's own reads. Replace the two
 * `next_` functions by what reads your sensors.
 *
 *     cc -o fly_euroc fly_euroc.c $(pkg-config --cflags --libs plumbline libpng)
 *     plumbline fly --config euroc.toml --set driver.imu.connect=serial:///tmp/imu:921600 --set driver.frames.listen=/tmp/frames
 *     ./fly_euroc V1_01_easy /tmp/imu /tmp/frames
 */
#define _POSIX_C_SOURCE 200809L
#include <inttypes.h>
#include <plumbline.h>
#include <png.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

static const char *folder;

static FILE *open_table(const char *sensor) {
    char path[4096];
    snprintf(path, sizeof path, "%s/mav0/%s/data.csv", folder, sensor);
    FILE *table = fopen(path, "r");
    if (table == NULL || fscanf(table, "%*[^\n]") < 0) exit((perror(path), 1));
    return table;
}

static int next_sample(FILE *table, plumbline_imu_sample *sample) {
    double *gyro = sample->gyro_rad_s, *accel = sample->accel_m_s2;
    return fscanf(table, "%" SCNd64 ",%lf,%lf,%lf,%lf,%lf,%lf", &sample->stamp_ns, gyro, gyro + 1, gyro + 2, accel,
                  accel + 1, accel + 2) == 7;
}

static plumbline_image read_png(int camera, const char *name) {
    static uint8_t pixels[2][4096 * 3072];
    png_image png = {.version = PNG_IMAGE_VERSION};
    char path[4096];
    snprintf(path, sizeof path, "%s/mav0/cam%d/data/%s", folder, camera, name);
    int is_read = png_image_begin_read_from_file(&png, path);
    png.format = PNG_FORMAT_GRAY;
    is_read = is_read && PNG_IMAGE_SIZE(png) <= sizeof pixels[camera] &&
              png_image_finish_read(&png, NULL, pixels[camera], 0, NULL);
    png_image_free(&png);
    return (plumbline_image){is_read ? pixels[camera] : NULL, png.width, png.height, png.width};
}

static int next_frame(FILE *table, plumbline_frame *frame) {
    char name[256];
    if (fscanf(table, "%" SCNd64 ",%255s", &frame->stamp_ns, name) != 2) return 0;
    frame->left = read_png(0, name);
    frame->right = read_png(1, name);
    return 1;
}

static void wait_until(int64_t due_ns) {
    struct timespec due = {.tv_sec = due_ns / 1000000000, .tv_nsec = due_ns % 1000000000};
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, NULL) != 0) continue;
}

int main(int argc, char **argv) {
    const plumbline_imu_about about = {.rate_hz = 200, .gyro_range_rad_s = 17.4, .accel_range_m_s2 = 156.9};
    plumbline_imu *imu = NULL;
    plumbline_frames *frames = NULL;
    plumbline_error error;
    if (argc != 4) return fputs("usage: fly_euroc FOLDER IMU_LINK FRAME_SOCKET\n", stderr), 2;
    folder = argv[1];
    FILE *samples = open_table("imu0"), *images = open_table("cam0");
    if (plumbline_imu_open(argv[2], &about, &imu, &error) < 0) return fprintf(stderr, "%s\n", error.text), 1;
    plumbline_status status = plumbline_frames_connect(argv[3], 30000, &frames, &error);
    plumbline_imu_sample sample;
    plumbline_frame frame;
    uint64_t sent = 0;
    int has_frame = next_frame(images, &frame);
    /* From the time of the recording to CLOCK_MONOTONIC, by which all that is sent is stamped. */
    int64_t shift_ns = 0;
    while (status >= 0 && has_frame && next_sample(samples, &sample)) {
        if (shift_ns == 0) shift_ns = plumbline_monotonic_ns() - sample.stamp_ns;
        wait_until(sample.stamp_ns += shift_ns);
        status = plumbline_imu_send(imu, &sample, &error);
        if (status < 0 || frame.stamp_ns + shift_ns > sample.stamp_ns) continue;
        frame.stamp_ns += shift_ns;
        frame.sequence = sent++;
        status = plumbline_frames_send(frames, &frame, &error);
        has_frame = next_frame(images, &frame);
    }
    if (status < 0) fprintf(stderr, "%s\n", error.text);
    printf("%" PRIu64 " frames sent\n", sent);
    if (frames != NULL) plumbline_frames_free(frames, NULL);
    plumbline_imu_free(imu, NULL);
    return fclose(samples) || fclose(images) || status < 0;
}
