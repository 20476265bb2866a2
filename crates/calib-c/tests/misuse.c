/* Invalid arguments return an error code and never crash. Usage: misuse < SITE.json */

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
    /* A misaligned address. */
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

static void getters(const CalibCamera *camera)
{
    char id[16];
    const char *model = "";
    size_t needed = 0;
    uint32_t width = 0, height = 0;
    uint8_t known = 7;
    double position[3], degrees[3], focal = 0, matrix[9], coefficients[CALIB_COEFFICIENTS], lens_focal = 0, covariance[CALIB_UNKNOWNS * CALIB_UNKNOWNS];
    EXPECT(calib_camera_id(camera, id, 3, &needed) == CALIB_RESULT_SHORT && needed == strlen("camera-2") + 1);
    EXPECT(calib_camera_id(camera, id, sizeof id, NULL) == CALIB_RESULT_OK && strcmp(id, "camera-2") == 0);
    EXPECT(calib_camera_size(camera, &width, &height) == CALIB_RESULT_OK && width == 1920 && height == 1080);
    EXPECT(calib_camera_position(camera, position) == CALIB_RESULT_OK && position[2] > 1.0 && position[2] < 10.0);
    EXPECT(calib_camera_angles(camera, degrees) == CALIB_RESULT_OK && fabs(degrees[1]) < 90.0);
    EXPECT(calib_camera_scale_known(camera, &known) == CALIB_RESULT_OK && known == 1);
    EXPECT(calib_camera_focal(camera, &focal) == CALIB_RESULT_OK && focal > 100.0);
    EXPECT(calib_camera_matrix(camera, matrix) == CALIB_RESULT_OK && matrix[8] == 1.0);
    EXPECT(fabs(matrix[0] - focal) < 1e-9 && fabs(matrix[4] - focal) < 1e-9 && matrix[1] == 0.0);
    EXPECT(calib_camera_distortion(camera, &model, coefficients, &lens_focal) == CALIB_RESULT_OK);
    EXPECT(model == NULL || strlen(model) > 0);
    EXPECT(calib_camera_covariance(camera, covariance) == CALIB_RESULT_OK && covariance[1] == covariance[CALIB_UNKNOWNS]);
    EXPECT(calib_camera_size(camera, NULL, &height) == CALIB_RESULT_NULL);
    EXPECT(calib_camera_position(NULL, position) == CALIB_RESULT_NULL);
    EXPECT(calib_camera_position(camera, NULL) == CALIB_RESULT_NULL);
    EXPECT(calib_camera_angles(camera, NULL) == CALIB_RESULT_NULL);
    EXPECT(calib_camera_scale_known(camera, NULL) == CALIB_RESULT_NULL);
    EXPECT(calib_camera_focal(camera, NULL) == CALIB_RESULT_NULL);
    EXPECT(calib_camera_matrix(camera, NULL) == CALIB_RESULT_NULL);
    EXPECT(calib_camera_distortion(camera, NULL, coefficients, &lens_focal) == CALIB_RESULT_NULL);
    EXPECT(calib_camera_distortion(camera, &model, NULL, &lens_focal) == CALIB_RESULT_NULL);
    EXPECT(calib_camera_covariance(camera, NULL) == CALIB_RESULT_NULL);
}

/* J C J^T is the calibration's part of the covariance, and a box has the covariance of its foot point. */
static void covariances(const CalibCamera *camera)
{
    const double u[1] = {960}, v[1] = {1000}, boxes[4] = {900, 600, 1020, 1000};
    double jacobian[2 * CALIB_UNKNOWNS], covariance[CALIB_UNKNOWNS * CALIB_UNKNOWNS], pixel[4], calibration[4], box_pixel[4], box_calibration[4];
    EXPECT(calib_camera_floor_jacobian(camera, 1, u, v, jacobian) == CALIB_RESULT_OK);
    EXPECT(calib_camera_covariance(camera, covariance) == CALIB_RESULT_OK);
    EXPECT(calib_camera_floor_covariance(camera, 0.0, 1.5, 1, u, v, pixel, calibration) == CALIB_RESULT_OK);
    EXPECT(calib_camera_boxes_covariance(camera, 0.0, 1.5, CALIB_BOX_CORNERS, 1, boxes, box_pixel, box_calibration) ==
           CALIB_RESULT_OK);
    EXPECT(memcmp(pixel, box_pixel, sizeof pixel) == 0);
    EXPECT(memcmp(calibration, box_calibration, sizeof calibration) == 0);
    for (int row = 0; row < 2; row++) {
        for (int column = 0; column < 2; column++) {
            double sum = 0.0;
            for (int a = 0; a < CALIB_UNKNOWNS; a++) {
                for (int b = 0; b < CALIB_UNKNOWNS; b++) {
                    sum += jacobian[CALIB_UNKNOWNS * row + a] * covariance[CALIB_UNKNOWNS * a + b] *
                           jacobian[CALIB_UNKNOWNS * column + b];
                }
            }
            EXPECT(calibration[3] > 0.0 && fabs(sum - calibration[2 * row + column]) < 1e-9 * calibration[3]);
        }
    }
    EXPECT(calib_camera_boxes_covariance(camera, 0.0, -1.0, CALIB_BOX_CORNERS, 1, boxes, pixel, calibration) ==
           CALIB_RESULT_REFUSED);
    EXPECT(calib_camera_boxes_covariance(camera, 0.0, 1.0, 9, 1, boxes, pixel, calibration) == CALIB_RESULT_REFUSED);
}

static void plan(const CalibSite *without)
{
    static const char TEXT[] = "{\"format\": \"calib-site\", \"version\": 1, \"plan\": {\"metres_per_px\": 0.02, "
                               "\"origin_px\": [10, 500]}}";
    CalibSite *site = NULL;
    double metres = 0.0, x[2] = {0, 3}, y[2] = {0, 4}, px[2], py[2], back_x[2], back_y[2];
    EXPECT(calib_site_parse(TEXT, sizeof TEXT - 1, &site, NULL, 0) == CALIB_RESULT_OK);
    EXPECT(calib_site_plan_metres_per_px(site, &metres) == CALIB_RESULT_OK && metres == 0.02);
    EXPECT(calib_site_floor_to_plan(site, 2, x, y, px, py) == CALIB_RESULT_OK);
    EXPECT(px[0] == 10.0 && py[0] == 500.0 && fabs(hypot(px[1] - px[0], py[1] - py[0]) - 250.0) < 1e-9);
    EXPECT(calib_site_plan_to_floor(site, 2, px, py, back_x, back_y) == CALIB_RESULT_OK);
    EXPECT(fabs(back_x[1] - 3.0) < 1e-12 && fabs(back_y[1] - 4.0) < 1e-12);
    EXPECT(calib_site_floor_to_plan(site, 2, x, y, x, py) == CALIB_RESULT_OVERLAP);
    EXPECT(calib_site_floor_to_plan(site, 2, x, NULL, px, py) == CALIB_RESULT_NULL);
    EXPECT(calib_site_plan_to_floor(NULL, 2, px, py, x, y) == CALIB_RESULT_NULL);
    EXPECT(calib_site_plan_metres_per_px(site, NULL) == CALIB_RESULT_NULL);
    calib_site_free(site);
    EXPECT(calib_site_plan_metres_per_px(without, &metres) == CALIB_RESULT_REFUSED);
    EXPECT(calib_site_floor_to_plan(without, 2, x, y, px, py) == CALIB_RESULT_REFUSED);
}

/* Number of pointers of every mapping function, and the number of byte pointers among them, which come last. */
static const struct {
    int pointers, bytes;
} FUNCTIONS[] = {{5, 1}, {4, 1}, {4, 0}, {6, 1}, {3, 0}, {3, 0}, {3, 0}, {4, 0}};

enum { FUNCTION_COUNT = sizeof FUNCTIONS / sizeof *FUNCTIONS };

static CalibResult call(int function, const CalibCamera *camera, size_t n, void *const p[6])
{
    switch (function) {
    case 0: return calib_camera_to_floor(camera, 0.0, n, p[0], p[1], p[2], p[3], p[4]);
    case 1: return calib_camera_boxes_to_floor(camera, 0.0, CALIB_BOX_CORNERS, n, p[0], p[1], p[2], p[3]);
    case 2: return calib_camera_floor_covariance(camera, 0.0, 1.0, n, p[0], p[1], p[2], p[3]);
    case 3: return calib_camera_to_pixel(camera, n, p[0], p[1], p[2], p[3], p[4], p[5]);
    case 4: return calib_camera_rays(camera, n, p[0], p[1], p[2]);
    case 5: return calib_camera_floor_jacobian(camera, n, p[0], p[1], p[2]);
    case 6: return calib_camera_boxes_covariance(camera, 0.0, 1.0, CALIB_BOX_CORNERS, n, p[0], p[1], p[2]);
    default: return calib_camera_undistort(camera, n, p[0], p[1], p[2], p[3]);
    }
}

static void pointers(const CalibCamera *camera)
{
    static double places[6][4 * 24], spare[4 * 24];
    unsigned char *odd = (unsigned char *)spare + 1;
    for (int function = 0; function < FUNCTION_COUNT; function++) {
        void *good[6], *bad[6];
        const int count = FUNCTIONS[function].pointers;
        for (int i = 0; i < count; i++) {
            good[i] = places[i];
        }
        EXPECT(call(function, camera, 4, good) == CALIB_RESULT_OK);
        EXPECT(call(function, NULL, 4, good) == CALIB_RESULT_NULL);
        EXPECT(call(function, camera, SIZE_MAX, good) != CALIB_RESULT_OK);
        for (int i = 0; i < count; i++) {
            memcpy(bad, good, sizeof good);
            bad[i] = NULL;
            EXPECT(call(function, camera, 4, bad) == CALIB_RESULT_NULL);
            EXPECT(call(function, camera, 0, bad) == CALIB_RESULT_OK);
            bad[i] = odd;
            if (i < count - FUNCTIONS[function].bytes) {
                EXPECT(call(function, camera, 1, bad) == CALIB_RESULT_MISALIGNED);
            }
        }
        /* Output arrays must not overlap other arrays. */
        memcpy(bad, good, sizeof good);
        bad[count - 1] = good[count - 2];
        EXPECT(call(function, camera, 4, bad) == CALIB_RESULT_OVERLAP);
    }
}

/* Any bit pattern is a valid number. */
static void any_numbers(const CalibCamera *camera)
{
    static double places[6][4 * 24];
    void *all[6];
    uint64_t state = 88172645463325252u;
    for (int i = 0; i < 6; i++) {
        all[i] = places[i];
    }
    for (int round = 0; round < 50000; round++) {
        for (size_t i = 0; i < 6 * 16; i++) {
            state ^= state << 13, state ^= state >> 7, state ^= state << 17;
            /* Half of the numbers are in the range of pixels and metres. */
            const double usual = (double)(state % 4000) - 1000.0;
            memcpy(&places[i / 16][i % 16], state >> 63 ? (const void *)&usual : (const void *)&state, sizeof usual);
        }
        EXPECT(call(round % FUNCTION_COUNT, camera, state % 5, all) == CALIB_RESULT_OK);
    }
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
    plan(site);
    calib_site_free(site);
    mapping(camera);
    getters(camera);
    covariances(camera);
    pointers(camera);
    any_numbers(camera);
    calib_camera_free(camera);
    printf("%d failures\n", failures);
    return failures != 0;
}
