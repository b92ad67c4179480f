/* Prints the odometry of a flight on this computer, from its local socket (docs/local-socket.md). Little-endian computers.
 *
 *     cc -O2 -Wall -o read_local examples/read_local.c
 *     plumbline replay sim:room --speed 1 --set local.path=/tmp/plumbline
 *     ./read_local /tmp/plumbline
 */
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

struct header { uint16_t kind, version; uint32_t length; uint64_t sequence; };
struct odometry {  /* the layout of kind 16 */
    int64_t stamp_ns, handed_over_ns;
    uint64_t sequence;
    double position_m[3], rotation_xyzw[4], velocity_m_s[3], rate_rad_s[3], covariance[45];
    uint32_t health, reset_counter, jumps;
    uint8_t state;
    int8_t quality;
    uint16_t reserved;
};
enum { SUBSCRIBE = 1, HELLO = 1, LOST = 2, ODOMETRY = 16, END = 25 };

static int receive(int flight, void *to, size_t count) {
    return recv(flight, to, count, MSG_WAITALL) == (ssize_t)count;
}

int main(int argc, char **argv) {
    static const char *states[] = {"initialising", "tracking", "blind", "failed"};
    static char content[1 << 16];
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    int flight = socket(AF_UNIX, SOCK_STREAM, 0);
    strncpy(address.sun_path, argc > 1 ? argv[1] : "", sizeof address.sun_path - 1);
    if (connect(flight, (struct sockaddr *)&address, sizeof address) != 0) {
        perror(address.sun_path);
        return 1;
    }
    struct { struct header header; uint64_t kinds; } subscribe = {{SUBSCRIBE, 1, 8, 1}, 1 << ODOMETRY};
    if (write(flight, &subscribe, sizeof subscribe) != sizeof subscribe) return 1;
    struct header header;
    while (receive(flight, &header, sizeof header) && header.kind != END) {
        if (header.length > sizeof content || !receive(flight, content, header.length)) return 1;
        if (header.kind == HELLO && memcmp(content, "PLMBLCL1", 8) != 0) return 1;
        if (header.kind == LOST) printf("lost %llu\n", (unsigned long long)*(uint64_t *)content);
        struct odometry o;
        if (header.kind != ODOMETRY || header.length < sizeof o) continue;
        memcpy(&o, content, sizeof o);
        printf("%.3f s  %.3f %.3f %.3f m  %s  quality %d\n", (double)o.stamp_ns * 1e-9, o.position_m[0], o.position_m[1],
               o.position_m[2], states[o.state & 3], o.quality);
        fflush(stdout);
    }
    return 0;
}
