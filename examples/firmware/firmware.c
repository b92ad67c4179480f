#include "firmware.h"
#include "plumbline_device.h"

/* Bytes of the host that are read at once: a stream that never ends must not hold up samples. */
enum { MAX_BYTES_AT_ONCE = 64 };
/* Shortest period of triggers. Cameras are not faster. */
#define MIN_TRIGGER_PERIOD_NS 1000000u

static board_description description;
static plumbline_receiver receiver;
static plumbline_settings settings = {0, 0, 1000, 3};
static uint8_t frame[PLUMBLINE_MAX_FRAME];

/* Triggers: when the next one is due, when the pulse of the last one ends (0: it has ended), and how many there were. */
static uint64_t next_trigger_ns, pulse_ends_ns, period_ns;
static uint32_t triggers;

static void send_hello(void)
{
    board_send(frame, plumbline_hello(frame, description.version, description.device_id, settings.imu_rate_mhz,
                                      description.gyro_range_rad_s, description.accel_range_m_s2));
}

void firmware_start(const board_description *of_board)
{
    description = *of_board;
    settings.imu_rate_mhz = board_set_imu_rate(0);
    send_hello();
}

/* The sample's number says what is lost: one that finds no room is not sent again. */
static void send_samples(void)
{
    board_sample sample;
    while (board_take_sample(&sample)) {
        board_send(frame, plumbline_sample(frame, sample.sequence, sample.time_ns, sample.gyro_rad_s, sample.accel_m_s2,
                                           sample.temperature, sample.flags));
    }
}

static void end_pulse(uint64_t now_ns)
{
    if (pulse_ends_ns != 0 && now_ns >= pulse_ends_ns) {
        board_trigger(settings.cameras, false);
        pulse_ends_ns = 0;
    }
}

static void begin_pulse(uint64_t now_ns)
{
    if (period_ns == 0 || pulse_ends_ns != 0 || now_ns < next_trigger_ns)
        return;
    uint64_t edge_ns = board_trigger(settings.cameras, true);
    uint32_t pulse_ns = settings.trigger_pulse_us * 1000u;
    pulse_ends_ns = edge_ns + pulse_ns;
    /* Periods follow one another without a drift; after a standstill they begin anew. */
    next_trigger_ns += period_ns;
    if (next_trigger_ns <= now_ns)
        next_trigger_ns = now_ns + period_ns;
    board_send(frame, plumbline_trigger(frame, triggers++, edge_ns, pulse_ns, settings.cameras));
}

/* Takes the settings of the host as far as this device can, and says what it does. */
static void apply_settings(void)
{
    end_pulse(UINT64_MAX);
    settings = receiver.settings;
    settings.imu_rate_mhz = board_set_imu_rate(settings.imu_rate_mhz);
    period_ns = settings.trigger_rate_mhz == 0 ? 0 : 1000000000000u / settings.trigger_rate_mhz;
    if (period_ns != 0 && period_ns < MIN_TRIGGER_PERIOD_NS) {
        period_ns = MIN_TRIGGER_PERIOD_NS;
        settings.trigger_rate_mhz = (uint32_t)(1000000000000u / period_ns);
    }
    /* A pulse leaves a tenth of the period for the next edge. */
    uint64_t most_us = period_ns / 1000u * 9u / 10u;
    if (period_ns != 0 && settings.trigger_pulse_us > most_us)
        settings.trigger_pulse_us = (uint32_t)most_us;
    next_trigger_ns = board_now_ns() + period_ns;
    board_send(frame, plumbline_in_force(frame, &settings));
}

static void answer_host(void)
{
    for (int count = 0; count < MAX_BYTES_AT_ONCE; count++) {
        int byte = board_receive();
        if (byte < 0)
            return;
        uint8_t type = plumbline_receive(&receiver, (uint8_t)byte);
        uint64_t received_ns = board_now_ns();
        if (type == PLUMBLINE_ASK_TIME)
            board_send(frame, plumbline_time(frame, receiver.asked_ns, received_ns, board_now_ns()));
        else if (type == PLUMBLINE_ASK_HELLO)
            send_hello();
        else if (type == PLUMBLINE_SET)
            apply_settings();
    }
}

void firmware_poll(void)
{
    /* Edges first: they are late by what stands before them. */
    uint64_t now_ns = board_now_ns();
    end_pulse(now_ns);
    begin_pulse(now_ns);
    send_samples();
    answer_host();
}
