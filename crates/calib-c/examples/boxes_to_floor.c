/* Maps boxes of a detector to metres: boxes_to_floor SITE.json CAMERA */

#include <stdio.h>
#include <stdlib.h>

#include "calib.h"

static char *contents(const char *path, size_t *length)
{
    FILE *file = fopen(path, "rb");
    if (file == NULL) {
        return NULL;
    }
    size_t room = 1 << 16;
    char *text = NULL;
    *length = 0;
    for (;;) {
        char *more = realloc(text, room);
        if (more == NULL) {
            break;
        }
        text = more;
        *length += fread(text + *length, 1, room - *length, file);
        if (*length < room) {
            break;
        }
        room *= 2;
    }
    fclose(file);
    return text;
}

int main(int argc, char **argv)
{
    if (argc != 3) {
        fprintf(stderr, "usage: %s SITE.json CAMERA\n", argv[0]);
        return 2;
    }
    size_t length = 0;
    char *text = contents(argv[1], &length);
    if (text == NULL) {
        perror(argv[1]);
        return 1;
    }
    char error[512];
    CalibSite *site = NULL;
    CalibCamera *camera = NULL;
    /* The detector's stream has 1280 x 720 pixels. */
    const CalibStream stream = {.origin = CALIB_ORIGIN_CORNER, .width = 1280, .height = 720};
    CalibResult result = calib_site_parse(text, length, &site, error, sizeof error);
    free(text);
    if (result == CALIB_RESULT_OK) {
        result = calib_site_camera(site, argv[2], NULL, &stream, &camera, error, sizeof error);
    }
    calib_site_free(site);
    if (result != CALIB_RESULT_OK) {
        fprintf(stderr, "%s: %s\n", argv[1], error);
        return 1;
    }

    const double boxes[] = {600, 300, 660, 480, 100, 350, 180, 600};
    double x[2], y[2];
    uint8_t status[2];
    result = calib_camera_boxes_to_floor(camera, 0.0, CALIB_BOX_CORNERS, 2, boxes, x, y, status);
    calib_camera_free(camera);
    if (result != CALIB_RESULT_OK) {
        fprintf(stderr, "%s\n", calib_result_text((int32_t)result));
        return 1;
    }
    for (int i = 0; i < 2; i++) {
        printf("%.3f m, %.3f m, %s\n", x[i], y[i], calib_status_name(status[i]));
    }
    return 0;
}
