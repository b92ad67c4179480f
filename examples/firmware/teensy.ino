// A Teensy 4 that reads an IMU on its data-ready interrupt, triggers two cameras, and speaks Plumbline's serial protocol over USB
// (docs/serial-protocol.md). Fill in read_imu for your sensor. Not tried on a board: the protocol's part is compiled and tested on a host.
#include "plumbline_device.h"

const int DATA_READY = 2, TRIGGER = 3;
const uint32_t IMU_RATE_MHZ = 200000;
const uint8_t FIRMWARE[3] = {0, 1, 0};

plumbline_receiver from_host = {};
plumbline_settings settings = {IMU_RATE_MHZ, 0, 1000, 3};
uint8_t frame[PLUMBLINE_MAX_FRAME];
volatile uint32_t samples = 0;
volatile uint64_t sample_ns = 0;
uint32_t sent = 0, triggers = 0;
uint64_t next_trigger_ns = 0, pulse_ends_ns = 0;

// Reads rad/s and m/s^2 of the newest sample.
void read_imu(float gyro_rad_s[3], float accel_m_s2[3]) { /* your sensor over SPI */ }

// Time since the start: never begins anew.
uint64_t now_ns()
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
    sample_ns = now_ns();
    samples++;
}

void send(size_t count) { Serial.write(frame, count); }

void setup()
{
    pinMode(TRIGGER, OUTPUT);
    attachInterrupt(digitalPinToInterrupt(DATA_READY), on_data_ready, RISING);
    send(plumbline_hello(frame, FIRMWARE, 1, IMU_RATE_MHZ, 34.9f, 156.9f));
}

void loop()
{
    noInterrupts();
    uint32_t count = samples;
    uint64_t at_ns = sample_ns;
    interrupts();
    if (count != sent) {
        float gyro[3], accel[3];
        read_imu(gyro, accel);
        sent = count;
        send(plumbline_sample(frame, count, at_ns, gyro, accel, -32768, 0));
    }
    uint64_t now = now_ns();
    if (pulse_ends_ns != 0 && now >= pulse_ends_ns) {
        digitalWriteFast(TRIGGER, LOW);
        pulse_ends_ns = 0;
    }
    if (settings.trigger_rate_mhz != 0 && now >= next_trigger_ns) {
        uint64_t period_ns = 1000000000000ULL / settings.trigger_rate_mhz;
        digitalWriteFast(TRIGGER, HIGH);
        uint64_t edge_ns = now_ns();
        uint32_t pulse_ns = settings.trigger_pulse_us * 1000;
        pulse_ends_ns = edge_ns + pulse_ns;
        next_trigger_ns = next_trigger_ns + period_ns > now ? next_trigger_ns + period_ns : now + period_ns;
        send(plumbline_trigger(frame, triggers++, edge_ns, pulse_ns, settings.cameras));
    }
    while (Serial.available()) {
        uint8_t type = plumbline_receive(&from_host, Serial.read());
        uint64_t received_ns = now_ns();
        if (type == PLUMBLINE_ASK_TIME) send(plumbline_time(frame, from_host.asked_ns, received_ns, now_ns()));
        if (type == PLUMBLINE_ASK_HELLO) send(plumbline_hello(frame, FIRMWARE, 1, IMU_RATE_MHZ, 34.9f, 156.9f));
        if (type == PLUMBLINE_SET) {
            settings = from_host.settings;
            settings.imu_rate_mhz = IMU_RATE_MHZ;
            send(plumbline_in_force(frame, &settings));
        }
    }
}
