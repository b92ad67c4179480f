/* Flies a EuRoC folder through the estimator and prints its path and the digest of all estimates.
 *
 *     cc -o replay_euroc replay_euroc.c $(pkg-config --cflags --libs plumbline libpng)
 *     ./replay_euroc euroc.toml V1_01_easy
 */
#include <inttypes.h>
#include <plumbline.h>
#include <png.h>
#include <stdio.h>
#include <stdlib.h>

static FILE *open_table(const char *folder, const char *sensor) {
    char path[4096];
    snprintf(path, sizeof path, "%s/mav0/%s/data.csv", folder, sensor);
    FILE *table = fopen(path, "r");
    if (table == NULL || fscanf(table, "%*[^\n]") < 0) exit((perror(path), 1));
    return table;
}

static plumbline_image read_png(const char *folder, int camera, const char *name) {
    static uint8_t pixels[2][4096 * 3072];
    png_image png = {.version = PNG_IMAGE_VERSION};
    char path[4096];
    snprintf(path, sizeof path, "%s/mav0/cam%d/data/%s", folder, camera, name);
    int is_read = png_image_begin_read_from_file(&png, path);
    png.format = PNG_FORMAT_GRAY;
    is_read = is_read && PNG_IMAGE_SIZE(png) <= sizeof pixels[camera] &&
              png_image_finish_read(&png, NULL, pixels[camera], 0, NULL);
    png_image_free(&png);
    return (plumbline_image){is_read ? pixels[camera] : NULL, png.width, png.height, png.width};
}

int main(int argc, char **argv) {
    plumbline_estimator *estimator;
    plumbline_error error;
    if (argc != 3) return fputs("usage: replay_euroc CONFIG.toml FOLDER\n", stderr), 2;
    if (plumbline_estimator_from_file(argv[1], &estimator, &error) < 0) return fprintf(stderr, "%s\n", error.text), 1;
    FILE *imu = open_table(argv[2], "imu0"), *camera = open_table(argv[2], "cam0");
    plumbline_imu_sample s = {.stamp_ns = INT64_MIN};
    plumbline_frame frame = {.sequence = 0};
    plumbline_estimate estimate;
    char name[256], digest[65];
    for (; fscanf(camera, "%" SCNd64 ",%255s", &frame.stamp_ns, name) == 2; frame.sequence++) {
        int64_t needed_ns = INT64_MIN;
        plumbline_estimator_imu_needed_until(estimator, frame.stamp_ns, &needed_ns, NULL);
        while (s.stamp_ns < needed_ns && fscanf(imu, "%" SCNd64 ",%lf,%lf,%lf,%lf,%lf,%lf", &s.stamp_ns, s.gyro_rad_s,
               s.gyro_rad_s + 1, s.gyro_rad_s + 2, s.accel_m_s2, s.accel_m_s2 + 1, s.accel_m_s2 + 2) == 7)
            plumbline_estimator_add_imu(estimator, &s, NULL, NULL);
        frame.left = read_png(argv[2], 0, name);
        frame.right = read_png(argv[2], 1, name);
        plumbline_status status = plumbline_estimator_add_frame(estimator, &frame, &estimate, &error);
        if (status < 0) fprintf(stderr, "%s\n", error.text);
        const double *p = estimate.position_m;
        if (status == PLUMBLINE_STATUS_OK) printf("%" PRId64 " %f %f %f\n", estimate.stamp_ns, p[0], p[1], p[2]);
    }
    if (plumbline_estimator_digest(estimator, &digest, &error) == PLUMBLINE_STATUS_OK) printf("digest %s\n", digest);
    fclose(imu), fclose(camera);
    return plumbline_estimator_free(estimator, NULL) < 0;
}
