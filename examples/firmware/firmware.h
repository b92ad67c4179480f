/* The whole firmware of a microcontroller with an IMU and triggered cameras, but for its board (docs/serial-protocol.md). A board provides
 * the functions below and calls firmware_start once and firmware_poll as often as it can. teensy.ino is such a board. */
#ifndef FIRMWARE_H
#define FIRMWARE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* A sample of the IMU. Its time is that of the data-ready interrupt; its number counts samples of the sensor, also those that were missed. */
typedef struct {
    uint64_t time_ns;
    uint32_t sequence;
    float gyro_rad_s[3], accel_m_s2[3];
    int16_t temperature; /* Hundredths of a degree Celsius; -32768 for none. */
    uint8_t flags;       /* Bit 0: gyroscope at the end of its range; bit 1: accelerometer; bit 2: sensor failed. */
} board_sample;

typedef struct {
    uint8_t version[3];
    uint64_t device_id;
    float gyro_range_rad_s, accel_range_m_s2;
} board_description;

#ifdef __cplusplus
extern "C" {
#endif

/* Board: time since the start, which never begins anew. */
uint64_t board_now_ns(void);
/* Board: the oldest sample that was not taken yet; false if there is none. */
bool board_take_sample(board_sample *sample);
/* Board: asks the sensor for a rate (0: as it likes), thousandths of a hertz; returns the rate that it has from now on. */
uint32_t board_set_imu_rate(uint32_t rate_mhz);
/* Board: level of the trigger of the cameras in the set (bit 0: the first); returns the time of the edge. */
uint64_t board_trigger(uint8_t cameras, bool is_high);
/* Board: sends all bytes, or none and returns false if there is no room. */
bool board_send(const uint8_t *bytes, size_t count);
/* Board: the next byte from the host, or -1. */
int board_receive(void);

/* Starts: tells the host who the device is. */
void firmware_start(const board_description *description);
/* Does all that is due. */
void firmware_poll(void);

#ifdef __cplusplus
}
#endif

#endif
