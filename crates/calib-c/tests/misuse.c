/* What must not be handed over is an answer, never a crash: misuse SITE.json-text on stdin */

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "calib.h"

static int failures;

#define EXPECT(condition) \
    do { \
        if (!(condition)) { \
            fprintf(stderr, "line %d: %s\n", __LINE__, #condition); \
            failures++; \
        } \
    } while (0)

static void mapping(const CalibCamera *camera)
{
    double u[4] = {100, 200, 300, NAN}, v[4] = {500, 600, INFINITY, 4}, x[4], y[4], four[16];
    uint8_t status[4];
    unsigned char bytes[64];
    memset(bytes, 0, sizeof bytes);
    /* An address that no double has. */
    double *odd = (double *)(void *)(bytes + 1 + (((uintptr_t)bytes & 7) == 7));
    EXPECT(calib_camera_to_floor(camera, 0.0, 4, u, v, x, y, status) == CALIB_RESULT_OK);
    EXPECT(status[3] == CALIB_STATUS_MISSING && isnan(x[3]));
    EXPECT(calib_camera_to_floor(camera, 0.0, 0, NULL, NULL, NULL, NULL, NULL) == CALIB_RESULT_OK);
    EXPECT(calib_camera_to_floor(NULL, 0.0, 4, u, v, x, y, status) == CALIB_RESULT_NULL);
    EXPECT(calib_camera_to_floor(camera, 0.0, 4, NULL, v, x, y, status) == CALIB_RESULT_NULL);
    EXPECT(calib_camera_to_floor(camera, 0.0, 4, u, v, x, y, NULL) == CALIB_RESULT_NULL);
    EXPECT(calib_camera_to_floor(camera, 0.0, 4, odd, v, x, y, status) == CALIB_RESULT_MISALIGNED);
    EXPECT(calib_camera_to_floor(camera, 0.0, 4, u, v, odd, y, status) == CALIB_RESULT_MISALIGNED);
    EXPECT(calib_camera_to_floor(camera, 0.0, 4, u, v, u, y, status) == CALIB_RESULT_OVERLAP);
    EXPECT(calib_camera_to_floor(camera, 0.0, 3, u, v, x, x + 1, status) == CALIB_RESULT_OVERLAP);
    EXPECT(calib_camera_to_floor(camera, NAN, 4, u, v, x, y, status) == CALIB_RESULT_REFUSED);
    EXPECT(calib_camera_to_floor(camera, 0.0, SIZE_MAX / 4, u, v, x, y, status) != CALIB_RESULT_OK);
    EXPECT(calib_camera_boxes_to_floor(camera, 0.0, 9, 1, four, x, y, status) == CALIB_RESULT_REFUSED);
    EXPECT(calib_camera_floor_covariance(camera, 0.0, -1.0, 2, u, v, four, four + 8) == CALIB_RESULT_REFUSED);
    EXPECT(calib_camera_floor_covariance(camera, 0.0, 1.0, 2, u, v, four, four + 7) == CALIB_RESULT_OVERLAP);
    EXPECT(calib_camera_floor_covariance(camera, 0.0, 1.0, 2, u, v, four, four + 8) == CALIB_RESULT_OK);
    EXPECT(calib_camera_rays(camera, SIZE_MAX, u, v, four) == CALIB_RESULT_REFUSED);
    EXPECT(calib_camera_undistort(camera, 4, u, v, x, y) == CALIB_RESULT_OK);
    EXPECT(calib_camera_to_pixel(camera, 4, x, y, u, v, four, status) == CALIB_RESULT_OK);
}

static void texts(const CalibSite *site)
{
    char id[16], error[8] = "-------";
    size_t count = 0, needed = 0;
    CalibSite *none = NULL;
    CalibCamera *camera = NULL;
    EXPECT(calib_site_parse("{", 1, &none, error, sizeof error) == CALIB_RESULT_REFUSED);
    EXPECT(none == NULL && strlen(error) == sizeof error - 1);
    EXPECT(calib_site_parse("\xff\xff", 2, &none, error, 1) == CALIB_RESULT_NOT_TEXT && error[0] == 0);
    EXPECT(calib_site_parse(NULL, 5, &none, NULL, 0) == CALIB_RESULT_NULL);
    EXPECT(calib_site_parse(NULL, 0, &none, NULL, 9) == CALIB_RESULT_REFUSED);
    EXPECT(calib_site_camera_count(site, &count) == CALIB_RESULT_OK && count == 20);
    EXPECT(calib_site_camera_count(site, NULL) == CALIB_RESULT_NULL);
    EXPECT(calib_site_camera_id(site, 0, id, 3, &needed) == CALIB_RESULT_SHORT && needed == strlen("camera-0") + 1);
    EXPECT(calib_site_camera_id(site, 0, id, needed, NULL) == CALIB_RESULT_OK && strcmp(id, "camera-0") == 0);
    EXPECT(calib_site_camera_id(site, 20, id, sizeof id, NULL) == CALIB_RESULT_REFUSED);
    EXPECT(calib_site_json(site, NULL, 0, &needed) == CALIB_RESULT_SHORT && needed > 1000);
    EXPECT(calib_site_camera(site, "roof", NULL, NULL, &camera, error, sizeof error) == CALIB_RESULT_REFUSED);
    EXPECT(calib_site_camera(site, NULL, NULL, NULL, &camera, error, sizeof error) == CALIB_RESULT_NULL);
    EXPECT(calib_site_camera(site, "camera-0", "noon", NULL, &camera, NULL, 0) == CALIB_RESULT_REFUSED);
    EXPECT(calib_site_camera(site, "camera-0", NULL, NULL, NULL, NULL, 0) == CALIB_RESULT_NULL);
    const CalibStream wrong[] = {{.origin = 7}, {.fit = 7}, {.width = 640, .height = 640}, {.width = 5}, {.crop = {0, 0, -1, 1}}};
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        EXPECT(calib_site_camera(site, "camera-0", NULL, &wrong[i], &camera, NULL, 0) == CALIB_RESULT_REFUSED);
    }
    EXPECT(camera == NULL && calib_status_name(200) == NULL && strlen(calib_result_text(99)) > 0);
    calib_site_free(NULL);
    calib_camera_free(NULL);
}

int main(void)
{
    static char text[1 << 20];
    const size_t length = fread(text, 1, sizeof text, stdin);
    char error[512];
    CalibSite *site = NULL, *solved = NULL;
    CalibCamera *camera = NULL;
    if (calib_site_parse(text, length, &site, error, sizeof error) != CALIB_RESULT_OK) {
        fprintf(stderr, "%s\n", error);
        return 1;
    }
    texts(site);
    EXPECT(calib_site_calibrate(site, &solved) == CALIB_RESULT_OK);
    calib_site_free(solved);
    EXPECT(calib_site_camera(site, "camera-2", NULL, NULL, &camera, error, sizeof error) == CALIB_RESULT_OK);
    calib_site_free(site);
    mapping(camera);
    calib_camera_free(camera);
    printf("%d failures\n", failures);
    return failures != 0;
}
