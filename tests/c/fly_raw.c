/* Flies a stream of samples through the estimator: fly_raw CONFIG.toml STREAM [TIMES]. Prints the digest of all estimates;
 * with TIMES flies it again and again, later in time, and prints the resident memory after each.
 *
 * The stream has a byte for the kind, then 'I': stamp and six values; 'F': number, stamp, and width, height and pixels of
 * both images, left first, 0 x 0 for one that is missing. Little endian. */
#define _POSIX_C_SOURCE 200809L
#include <plumbline.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static const uint8_t *at, *end;

static void take(void *to, size_t count) {
    if ((size_t)(end - at) < count) exit((fputs("the stream is cut off\n", stderr), 1));
    memcpy(to, at, count);
    at += count;
}

static plumbline_image take_image(void) {
    uint32_t size[2];
    take(size, sizeof size);
    const size_t count = (size_t)size[0] * size[1];
    const plumbline_image image = {count > 0 ? at : NULL, size[0], size[1], size[0]};
    if ((size_t)(end - at) < count) exit((fputs("the stream is cut off\n", stderr), 1));
    at += count;
    return image;
}

static void report(plumbline_status status, const plumbline_error *error) {
    if (status < 0) fprintf(stderr, "%s\n", error->text);
}

/* Flies the stream, whose stamps and numbers are moved by these; how long it is, ns. */
static int64_t fly(plumbline_estimator *estimator, int64_t later_ns, uint64_t more) {
    int64_t first_ns = 0, last_ns = 0;
    plumbline_error error;
    while (at < end) {
        const uint8_t kind = *at++;
        if (kind == 'I') {
            plumbline_imu_sample sample;
            plumbline_odometry odometry;
            take(&sample, sizeof sample);
            last_ns = sample.stamp_ns;
            if (first_ns == 0) first_ns = last_ns;
            sample.stamp_ns += later_ns;
            report(plumbline_estimator_add_imu(estimator, &sample, &odometry, &error), &error);
        } else {
            plumbline_frame frame;
            plumbline_estimate estimate;
            take(&frame.sequence, sizeof frame.sequence);
            take(&frame.stamp_ns, sizeof frame.stamp_ns);
            frame.sequence += more;
            frame.stamp_ns += later_ns;
            frame.left = take_image();
            frame.right = take_image();
            report(plumbline_estimator_add_frame(estimator, &frame, &estimate, &error), &error);
        }
    }
    return last_ns - first_ns + 5000000;
}

static long resident_kb(void) {
    long pages = 0;
    FILE *file = fopen("/proc/self/statm", "r");
    if (file == NULL || fscanf(file, "%*s %ld", &pages) != 1) return -1;
    fclose(file);
    return pages * (sysconf(_SC_PAGESIZE) / 1024);
}

int main(int argc, char **argv) {
    plumbline_estimator *estimator;
    plumbline_error error;
    char digest[65];
    if (argc < 3) return fputs("usage: fly_raw CONFIG.toml STREAM [TIMES]\n", stderr), 2;
    FILE *file = fopen(argv[2], "rb");
    if (file == NULL || fseek(file, 0, SEEK_END) != 0) return perror(argv[2]), 1;
    const size_t count = (size_t)ftell(file);
    uint8_t *stream = malloc(count);
    rewind(file);
    if (stream == NULL || fread(stream, 1, count, file) != count) return perror(argv[2]), 1;
    fclose(file);
    if (plumbline_estimator_from_file(argv[1], &estimator, &error) < 0) return fprintf(stderr, "%s\n", error.text), 1;
    const long times = argc > 3 ? atol(argv[3]) : 1;
    int64_t later_ns = 0;
    for (long k = 0; k < times; k++) {
        at = stream, end = stream + count;
        later_ns += fly(estimator, later_ns, (uint64_t)k * 1000000);
        if (times > 1) {
            plumbline_estimator_reset(estimator, PLUMBLINE_RESET_HARD, NULL);
            printf("resident %ld kB\n", resident_kb());
        }
    }
    report(plumbline_estimator_digest(estimator, &digest, &error), &error);
    printf("digest %s\n", digest);
    free(stream);
    return plumbline_estimator_free(estimator, NULL) < 0;
}
