/* Board for examples/firmware/firmware.c on a host: the line is stdin and stdout, its samples come from a file in real time, and its clock runs
 * 45 millionths fast, from three seconds before the first sample on.
 * Usage: firmware_board SAMPLES SECONDS. A sample is: time of CLOCK_MONOTONIC (i64, ns), number (u32), gyroscope and accelerometer (6 f32).
 * The program ends after SECONDS. */
#define _GNU_SOURCE
#include "firmware.h"
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#define SKEW 45e-6

typedef struct {
    int64_t host_ns;
    uint32_t sequence;
    float values[6];
} row;

static FILE *samples;
static row next;
static bool has_next;
static int64_t first_ns;

static int64_t host_now_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

static uint64_t device_ns(int64_t host_ns)
{
    int64_t since = host_ns - first_ns;
    return (uint64_t)(3000000000LL + since + (int64_t)((double)since * SKEW));
}

static void read_next(void)
{
    has_next = fread(&next.host_ns, 8, 1, samples) == 1 && fread(&next.sequence, 4, 1, samples) == 1
               && fread(next.values, 4, 6, samples) == 6;
}

static void rest(long ns)
{
    struct timespec pause = {0, ns};
    nanosleep(&pause, NULL);
}

uint64_t board_now_ns(void) { return device_ns(host_now_ns()); }

bool board_take_sample(board_sample *sample)
{
    if (!has_next || host_now_ns() < next.host_ns)
        return false;
    sample->time_ns = device_ns(next.host_ns);
    sample->sequence = next.sequence;
    memcpy(sample->gyro_rad_s, next.values, 12);
    memcpy(sample->accel_m_s2, next.values + 3, 12);
    sample->temperature = 3100;
    sample->flags = 0;
    read_next();
    return true;
}

uint32_t board_set_imu_rate(uint32_t rate_mhz)
{
    (void)rate_mhz;
    return 200000;
}

uint64_t board_trigger(uint8_t cameras, bool is_high)
{
    (void)cameras;
    (void)is_high;
    return board_now_ns();
}

bool board_send(const uint8_t *bytes, size_t count)
{
    size_t sent = 0;
    for (int tries = 0; sent < count && tries < 20000; tries++) {
        ssize_t wrote = write(STDOUT_FILENO, bytes + sent, count - sent);
        if (wrote > 0)
            sent += (size_t)wrote;
        else if (wrote < 0 && errno == EAGAIN && sent == 0)
            return false;
        else if (wrote < 0 && errno != EAGAIN && errno != EINTR)
            return false;
        else
            rest(50000);
    }
    return sent == count;
}

int board_receive(void)
{
    static uint8_t bytes[64];
    static ssize_t count = 0, at = 0;
    if (at >= count) {
        count = read(STDIN_FILENO, bytes, sizeof bytes);
        at = 0;
    }
    return at < count ? bytes[at++] : -1;
}

int main(int argc, char **argv)
{
    samples = argc == 3 ? fopen(argv[1], "rb") : NULL;
    if (samples == NULL) {
        fprintf(stderr, "usage: firmware_board SAMPLES SECONDS\n");
        return 2;
    }
    fcntl(STDIN_FILENO, F_SETFL, fcntl(STDIN_FILENO, F_GETFL) | O_NONBLOCK);
    first_ns = host_now_ns();
    int64_t end_ns = first_ns + (int64_t)(atof(argv[2]) * 1e9);
    read_next();
    if (has_next)
        first_ns = next.host_ns;
    const board_description description = {{0, 1, 0}, 0x4711, 34.9f, 156.9f};
    firmware_start(&description);
    while (host_now_ns() < end_ns) {
        firmware_poll();
        rest(50000);
    }
    return 0;
}
