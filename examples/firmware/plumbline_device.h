/* The device's side of Plumbline's serial protocol (docs/serial-protocol.md), for a microcontroller with a C99 compiler: no allocation, no
 * library. A sketch for a Teensy is beside it (teensy.ino). Numbers are written as they lie in memory: little-endian, IEEE 754. */
#ifndef PLUMBLINE_DEVICE_H
#define PLUMBLINE_DEVICE_H

#include <stdint.h>
#include <string.h>

enum { PLUMBLINE_MAX_BODY = 96, PLUMBLINE_MAX_FRAME = PLUMBLINE_MAX_BODY + 3 };
enum { PLUMBLINE_ASK_HELLO = 0x81, PLUMBLINE_ASK_TIME = 0x82, PLUMBLINE_SET = 0x83 };

/* CRC-32/ISO-HDLC, as zlib's. */
static inline uint32_t plumbline_crc(const uint8_t *bytes, size_t count)
{
    uint32_t crc = 0xFFFFFFFFu;
    for (size_t i = 0; i < count; i++) {
        crc ^= bytes[i];
        for (int bit = 0; bit < 8; bit++)
            crc = crc >> 1 ^ (crc & 1 ? 0xEDB88320u : 0);
    }
    return ~crc;
}

/* Body of a message: its type, then what is put into it. */
typedef struct {
    uint8_t bytes[PLUMBLINE_MAX_BODY];
    size_t count;
} plumbline_body;

static inline void plumbline_put(plumbline_body *body, const void *value, size_t size)
{
    memcpy(body->bytes + body->count, value, size);
    body->count += size;
}

/* Writes 00, COBS of the body and its CRC, 00; returns the number of bytes. A body is shorter than COBS's block of 254. */
static inline size_t plumbline_frame(plumbline_body *body, uint8_t frame[PLUMBLINE_MAX_FRAME])
{
    uint32_t crc = plumbline_crc(body->bytes, body->count);
    plumbline_put(body, &crc, sizeof crc);
    size_t code = 1, end = 2;
    frame[0] = 0;
    for (size_t i = 0; i < body->count; i++) {
        if (body->bytes[i] == 0) {
            frame[code] = (uint8_t)(end - code);
            code = end++;
        } else {
            frame[end++] = body->bytes[i];
        }
    }
    frame[code] = (uint8_t)(end - code);
    frame[end++] = 0;
    return end;
}

/* A sample: time_ns is that of the data-ready interrupt, temperature hundredths of a degree (-32768: none), flags as in the document. */
static inline size_t plumbline_sample(uint8_t *frame, uint32_t sequence, uint64_t time_ns, const float gyro_rad_s[3],
                                      const float accel_m_s2[3], int16_t temperature, uint8_t flags)
{
    plumbline_body body = {{0x01}, 1};
    plumbline_put(&body, &sequence, 4);
    plumbline_put(&body, &time_ns, 8);
    plumbline_put(&body, gyro_rad_s, 12);
    plumbline_put(&body, accel_m_s2, 12);
    plumbline_put(&body, &temperature, 2);
    plumbline_put(&body, &flags, 1);
    return plumbline_frame(&body, frame);
}

/* A trigger: time_ns is that of the edge, pulse_ns 0 where the cameras decide on their exposure, cameras a set (bit 0: the first). */
static inline size_t plumbline_trigger(uint8_t *frame, uint32_t counter, uint64_t time_ns, uint32_t pulse_ns, uint8_t cameras)
{
    plumbline_body body = {{0x02}, 1};
    plumbline_put(&body, &counter, 4);
    plumbline_put(&body, &time_ns, 8);
    plumbline_put(&body, &pulse_ns, 4);
    plumbline_put(&body, &cameras, 1);
    return plumbline_frame(&body, frame);
}

/* Who the device is: when it starts, and as the answer to PLUMBLINE_ASK_HELLO. */
static inline size_t plumbline_hello(uint8_t *frame, const uint8_t firmware[3], uint64_t device_id, uint32_t imu_rate_mhz,
                                     float gyro_range_rad_s, float accel_range_m_s2)
{
    plumbline_body body = {{0x03, 1}, 2};
    plumbline_put(&body, firmware, 3);
    plumbline_put(&body, &device_id, 8);
    plumbline_put(&body, &imu_rate_mhz, 4);
    plumbline_put(&body, &gyro_range_rad_s, 4);
    plumbline_put(&body, &accel_range_m_s2, 4);
    return plumbline_frame(&body, frame);
}

/* The answer to PLUMBLINE_ASK_TIME, whose last byte came at received_ns. */
static inline size_t plumbline_time(uint8_t *frame, uint64_t asked_ns, uint64_t received_ns, uint64_t sent_ns)
{
    plumbline_body body = {{0x04}, 1};
    plumbline_put(&body, &asked_ns, 8);
    plumbline_put(&body, &received_ns, 8);
    plumbline_put(&body, &sent_ns, 8);
    return plumbline_frame(&body, frame);
}

typedef struct {
    uint32_t imu_rate_mhz, trigger_rate_mhz, trigger_pulse_us;
    uint8_t cameras;
} plumbline_settings;

/* The settings in force: the answer to PLUMBLINE_SET. */
static inline size_t plumbline_in_force(uint8_t *frame, const plumbline_settings *settings)
{
    plumbline_body body = {{0x05}, 1};
    plumbline_put(&body, &settings->imu_rate_mhz, 4);
    plumbline_put(&body, &settings->trigger_rate_mhz, 4);
    plumbline_put(&body, &settings->trigger_pulse_us, 4);
    plumbline_put(&body, &settings->cameras, 1);
    return plumbline_frame(&body, frame);
}

/* Bytes since the last zero; `asked_ns` and `settings` are those of the newest message. */
typedef struct {
    uint8_t bytes[PLUMBLINE_MAX_BODY + 1];
    size_t count;
    uint64_t asked_ns;
    plumbline_settings settings;
} plumbline_receiver;

/* Takes a byte from the host; returns the type of the message that it ends, or 0. Damaged and unknown ones are passed over. */
static inline uint8_t plumbline_receive(plumbline_receiver *from, uint8_t byte)
{
    if (byte != 0) {
        /* What is too long is passed over up to the next zero. */
        if (from->count < sizeof from->bytes)
            from->bytes[from->count] = byte;
        from->count++;
        return 0;
    }
    uint8_t body[PLUMBLINE_MAX_BODY + 1];
    size_t length = 0, count = from->count;
    from->count = 0;
    if (count < 6 || count > sizeof from->bytes)
        return 0;
    for (size_t i = 0; i < count;) {
        size_t next = i + from->bytes[i];
        if (next > count)
            return 0;
        while (++i < next)
            body[length++] = from->bytes[i];
        if (i < count)
            body[length++] = 0;
    }
    uint32_t crc;
    if (length < 5)
        return 0;
    length -= sizeof crc;
    memcpy(&crc, body + length, sizeof crc);
    if (crc != plumbline_crc(body, length))
        return 0;
    if (body[0] == PLUMBLINE_ASK_TIME && length >= 9) {
        memcpy(&from->asked_ns, body + 1, 8);
    } else if (body[0] == PLUMBLINE_SET && length >= 14) {
        memcpy(&from->settings.imu_rate_mhz, body + 1, 4);
        memcpy(&from->settings.trigger_rate_mhz, body + 5, 4);
        memcpy(&from->settings.trigger_pulse_us, body + 9, 4);
        from->settings.cameras = body[13];
    } else if (body[0] != PLUMBLINE_ASK_HELLO) {
        return 0;
    }
    return body[0];
}

#endif
