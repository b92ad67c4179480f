/* Prints the odometry and the health of a flight on this computer, and resets it softly where `reset` is asked for.
 *
 *     cc -o read_odometry read_odometry.c $(pkg-config --cflags --libs plumbline)
 *     plumbline replay sim:room --speed 1 --set local.path=/tmp/plumbline
 *     ./read_odometry /tmp/plumbline [reset]
 */
#include <inttypes.h>
#include <plumbline.h>
#include <stdio.h>

static void print_odometry(const plumbline_odometry *o) {
    const double *p = o->position_m;
    printf("%.3f s  %.3f %.3f %.3f m  %s  quality %d  resets %" PRIu32 "\n", (double)o->stamp_ns * 1e-9, p[0], p[1], p[2],
           plumbline_state_name(o->state), o->quality, o->reset_counter);
    fflush(stdout);
}

int main(int argc, char **argv) {
    plumbline_local *flight;
    plumbline_record record;
    plumbline_error error;
    plumbline_status status;
    if (argc < 2) return fputs("usage: read_odometry SOCKET [reset]\n", stderr), 2;
    if (plumbline_local_connect(argv[1], 10000, &flight, &error) < 0) return fprintf(stderr, "%s\n", error.text), 1;
    if (argc > 2 && plumbline_local_reset(flight, PLUMBLINE_RESET_SOFT, 2000, &error) < 0)
        fprintf(stderr, "%s\n", error.text);
    uint32_t health = UINT32_MAX;
    while ((status = plumbline_local_read(flight, 10000, &record, &error)) == PLUMBLINE_STATUS_OK) {
        char names[512];
        switch (record.kind) {
        case PLUMBLINE_RECORD_KIND_ODOMETRY:
            print_odometry(&record.content.odometry);
            break;
        case PLUMBLINE_RECORD_KIND_ESTIMATE:
            if (record.content.estimate.health == health) break;
            health = record.content.estimate.health;
            plumbline_health_text(health, names, sizeof names);
            printf("health: %s\n", health == 0 ? "good" : names);
            break;
        case PLUMBLINE_RECORD_KIND_LOST:
            printf("lost %" PRIu64 "\n", record.content.lost);
            break;
        }
    }
    if (status < 0) fprintf(stderr, "%s\n", error.text);
    plumbline_local_free(flight, NULL);
    return status != PLUMBLINE_STATUS_FLIGHT_ENDED;
}
