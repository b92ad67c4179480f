// Board for firmware.c: a Teensy 4 that reads an IMU on its data-ready interrupt, triggers two cameras, and speaks to the host over USB.
// Copy the folder to a sketch folder named teensy, and fill in read_imu and board_set_imu_rate for your sensor. Compiled for ARM in a
// test; not tried on a board.
#include "firmware.h"

const int DATA_READY = 2, TRIGGER[2] = {3, 4};
const uint32_t IMU_RATE_MHZ = 200000;

volatile uint32_t samples = 0;
volatile uint64_t sample_ns = 0;
uint32_t taken = 0;

// Reads rad/s and m/s^2 of the newest sample over SPI.
void read_imu(float gyro_rad_s[3], float accel_m_s2[3])
{
    for (int axis = 0; axis < 3; axis++) gyro_rad_s[axis] = accel_m_s2[axis] = 0;
}

uint32_t board_set_imu_rate(uint32_t) { return IMU_RATE_MHZ; }

uint64_t board_now_ns()
{
    static uint32_t last = 0;
    static uint64_t above = 0;
    noInterrupts();
    uint32_t now = micros();
    if (now < last) above += 1ULL << 32;
    last = now;
    uint64_t time_ns = (above | now) * 1000;
    interrupts();
    return time_ns;
}

void on_data_ready()
{
    sample_ns = board_now_ns();
    samples = samples + 1;
}

bool board_take_sample(board_sample *sample)
{
    noInterrupts();
    sample->sequence = samples;
    sample->time_ns = sample_ns;
    interrupts();
    if (sample->sequence == taken) return false;
    taken = sample->sequence;
    read_imu(sample->gyro_rad_s, sample->accel_m_s2);
    sample->temperature = -32768;
    sample->flags = 0;
    return true;
}

uint64_t board_trigger(uint8_t cameras, bool is_high)
{
    for (int camera = 0; camera < 2; camera++)
        if (cameras & 1 << camera) digitalWriteFast(TRIGGER[camera], is_high ? HIGH : LOW);
    return board_now_ns();
}

bool board_send(const uint8_t *bytes, size_t count)
{
    if ((size_t)Serial.availableForWrite() < count) return false;
    return Serial.write(bytes, count) == count;
}

int board_receive() { return Serial.available() ? Serial.read() : -1; }

void setup()
{
    for (int camera = 0; camera < 2; camera++) pinMode(TRIGGER[camera], OUTPUT);
    attachInterrupt(digitalPinToInterrupt(DATA_READY), on_data_ready, RISING);
    const board_description description = {{0, 1, 0}, 1, 34.9f, 156.9f};
    firmware_start(&description);
}

void loop() { firmware_poll(); }
