/* Speaks as a device does: answers what comes on stdin, and writes one frame of each kind first. */
#include "plumbline_device.h"
#include <stdio.h>

static void send(const uint8_t *frame, size_t count) { fwrite(frame, 1, count, stdout); }

int main(void)
{
    uint8_t frame[PLUMBLINE_MAX_FRAME];
    const uint8_t firmware[3] = {1, 2, 3};
    const float gyro[3] = {0.5f, -0.25f, 0.0f}, accel[3] = {0.0f, 0.0f, 9.81f};
    send(frame, plumbline_sample(frame, 258, 5000000000u, gyro, accel, 2550, 0));
    send(frame, plumbline_trigger(frame, 40, 5000000000u, 2000000, 3));
    send(frame, plumbline_hello(frame, firmware, 0xFEED00000000BEEFu, 1000000, 34.9f, 156.9f));
    plumbline_receiver from = {0};
    for (int byte; (byte = getchar()) != EOF;) {
        switch (plumbline_receive(&from, (uint8_t)byte)) {
        case PLUMBLINE_ASK_HELLO: send(frame, plumbline_hello(frame, firmware, 0, 0, 0, 0)); break;
        case PLUMBLINE_ASK_TIME: send(frame, plumbline_time(frame, from.asked_ns, 2, 3)); break;
        case PLUMBLINE_SET: send(frame, plumbline_in_force(frame, &from.settings)); break;
        }
    }
    return 0;
}
