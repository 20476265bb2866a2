/* Calibrated cameras: pixels of detectors to metres on the floor, and back.
 *
 * Metres with z up, the floor at z = 0; pixels from the corner of the image, x right and y down, unless a CalibStream
 * says otherwise. Nothing here keeps state outside of its handles; a handle may be used by any number of threads at
 * once, and is freed once, by one of them.
 */

#ifndef CALIB_H
#define CALIB_H

#include <stddef.h>
#include <stdint.h>

// Pixels count from the corner of the image: the centre of the first one is (0.5, 0.5).
#define CALIB_ORIGIN_CORNER 0

// Pixels count from the centre of the first one, as OpenCV's do.
#define CALIB_ORIGIN_CENTRE 1

// Nobody said how the image was brought to the size of the stream: refused where that matters.
#define CALIB_FIT_UNSAID 0

// Each side by itself.
#define CALIB_FIT_STRETCH 1

// Both sides alike, with equal bars on two sides.
#define CALIB_FIT_LETTERBOX 2

// A box is its upper left corner, width and height.
#define CALIB_BOX_CORNER_SIZE 0

// A box is its upper left and lower right corner.
#define CALIB_BOX_CORNERS 1

// A box is its centre, width and height.
#define CALIB_BOX_CENTRE_SIZE 2

// Mapped, inside the EFOV or the image.
#define CALIB_STATUS_OK 0

// The pixel shows nothing of the plane: there is no point.
#define CALIB_STATUS_ABOVE_HORIZON 1

// Mapped, but outside the effective field of view.
#define CALIB_STATUS_OUTSIDE_EFOV 2

// Mapped, but outside the image.
#define CALIB_STATUS_OUTSIDE_IMAGE 3

// The lens shows nothing there: there is no point, or no pixel.
#define CALIB_STATUS_OUTSIDE_LENS 4

// The point is not in front of the camera: there is no pixel.
#define CALIB_STATUS_BEHIND_CAMERA 5

// There was nothing to map: a coordinate is not finite.
#define CALIB_STATUS_MISSING 6

// No calibration holds for it.
#define CALIB_STATUS_NO_CALIBRATION 7

// The pixel shows the wall of a pit, between its plane and the floor: there is no point.
#define CALIB_STATUS_ON_WALL 8

// Number of unknowns of a camera: x, y, z, yaw, pitch, roll, focal, five coefficients of the distortion and the principal
// point.
#define CALIB_UNKNOWNS 14

// How a call ended.
typedef enum CalibResult {
  // All is done.
  CALIB_RESULT_OK = 0,
  // A pointer is null that must not be.
  CALIB_RESULT_NULL = 1,
  // A pointer is not aligned for what it points to.
  CALIB_RESULT_MISALIGNED = 2,
  // An array that is written to overlaps another one.
  CALIB_RESULT_OVERLAP = 3,
  // A buffer is too short: what is needed is told, and nothing is written.
  CALIB_RESULT_SHORT = 4,
  // A text is not UTF-8.
  CALIB_RESULT_NOT_TEXT = 5,
  // A value cannot be used: the error says which, and what is expected.
  CALIB_RESULT_REFUSED = 6,
  // A mistake in this library: please report it.
  CALIB_RESULT_PANICKED = 7,
} CalibResult;

// A calibrated camera. Any number of threads may use it at once.
typedef struct CalibCamera CalibCamera;

// A site of cameras. Any number of threads may use it at once.
typedef struct CalibSite CalibSite;

// The stream that pixels are of; all zeros are the still that was calibrated.
typedef struct CalibStream {
  // `CALIB_ORIGIN_CORNER` or `CALIB_ORIGIN_CENTRE`.
  uint32_t origin;
  // `CALIB_FIT_STRETCH` or `CALIB_FIT_LETTERBOX`, where the proportion is not that of the still.
  uint32_t fit;
  // Width, in pixels; 0 and a height of 0 where it is that of what the stream shows.
  uint32_t width;
  // Height, in pixels.
  uint32_t height;
  // What the stream shows of the still: left, top, width and height, in pixels of the still; four zeros for
  // all of it.
  double crop[4];
} CalibStream;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// The version of this library, as text.
const char *calib_version(void);

// What a result is, in words; of a number that is none, that.
const char *calib_result_text(int32_t result);

// The name of a status as it stands in tables, such as "above-horizon"; null for a number that is none.
const char *calib_status_name(uint8_t status);

// Reads a site document, of `length` bytes of JSON text.
//
// `*site` becomes a handle that `calib_site_free` frees. What is wrong is written to `error`, of `error_size`
// bytes, cut off where it does not fit; `error` may be null.
//
// # Safety
// `length` bytes can be read from `json`, `*site` can be written, and `error_size` bytes of `error`.
enum CalibResult calib_site_parse(const char *json,
                                  size_t length,
                                  struct CalibSite **site,
                                  char *error,
                                  size_t error_size);

// Calibrates a site from what is drawn and entered in it.
//
// `*solved` becomes a new handle, of the site with the solutions written into it. A camera that cannot be solved
// does not keep the others from it: its entry says why.
//
// # Safety
// `site` is a handle that is not freed meanwhile, and `*solved` can be written.
enum CalibResult calib_site_calibrate(const struct CalibSite *site,
                                      struct CalibSite **solved);

// Writes a site as JSON text with a final zero into `buffer`, of `size` bytes, and how many bytes that takes into
// `*needed`, which may be null. With a buffer of no bytes, that alone.
//
// # Safety
// `site` is a handle that is not freed meanwhile; `size` bytes of `buffer` and `*needed` can be written.
enum CalibResult calib_site_json(const struct CalibSite *site,
                                 char *buffer,
                                 size_t size,
                                 size_t *needed);

// Writes how many camera entries a site has, calibrated or not, into `*count`.
//
// # Safety
// `site` is a handle that is not freed meanwhile, and `*count` can be written.
enum CalibResult calib_site_camera_count(const struct CalibSite *site, size_t *count);

// Writes the id of the camera entry `index` as `calib_site_json` writes its text.
//
// # Safety
// `site` is a handle that is not freed meanwhile; `size` bytes of `buffer` and `*needed` can be written.
enum CalibResult calib_site_camera_id(const struct CalibSite *site,
                                      size_t index,
                                      char *buffer,
                                      size_t size,
                                      size_t *needed);

// Frees a site; null is none.
//
// # Safety
// `site` is null, or a handle that is not used any more.
void calib_site_free(struct CalibSite *site);

// Writes the metres that a pixel of the plan is wide; `CALIB_RESULT_REFUSED` where the site has no plan.
//
// # Safety
// `site` is a handle that is not freed meanwhile, and `*metres` can be written.
enum CalibResult calib_site_plan_metres_per_px(const struct CalibSite *site, double *metres);

// Points of the floor, in metres, to pixels of the plan from its upper left corner, y down.
//
// All arrays have `count` values. Arrays that are written to overlap no other. `CALIB_RESULT_REFUSED` where the site has
// no plan.
//
// # Safety
// `site` is a handle that is not freed meanwhile; `count` values can be read of `x`, `y`, and written of `px`, `py`, and
// nobody else writes to them meanwhile.
enum CalibResult calib_site_floor_to_plan(const struct CalibSite *site,
                                          size_t count,
                                          const double *x,
                                          const double *y,
                                          double *px,
                                          double *py);

// Pixels of the plan to points of the floor, in metres: the way back of `calib_site_floor_to_plan`.
//
// # Safety
// As for `calib_site_floor_to_plan`.
enum CalibResult calib_site_plan_to_floor(const struct CalibSite *site,
                                          size_t count,
                                          const double *px,
                                          const double *py,
                                          double *x,
                                          double *y);

// The calibrated camera of an id.
//
// `at` is a time such as "2026-05-01T08:00:00Z"; needed where a camera that was moved has several periods, null
// elsewhere. `stream` says which pixels its calls speak of; null is the still, counted from its corner. `*camera`
// becomes a handle that `calib_camera_free` frees; it does not need the site any more. What is wrong is written to
// `error`, of `error_size` bytes, cut off where it does not fit; `error` may be null.
//
// # Safety
// `site` is a handle that is not freed meanwhile; `id` and `at` end with a zero; `*stream` can be read; `*camera`
// and `error_size` bytes of `error` can be written.
enum CalibResult calib_site_camera(const struct CalibSite *site,
                                   const char *id,
                                   const char *at,
                                   const struct CalibStream *stream,
                                   struct CalibCamera **camera,
                                   char *error,
                                   size_t error_size);

// Frees a camera; null is none.
//
// # Safety
// `camera` is null, or a handle that is not used any more.
void calib_camera_free(struct CalibCamera *camera);

// Writes the id of a camera as `calib_site_json` writes its text.
//
// # Safety
// `camera` is a handle that is not freed meanwhile; `size` bytes of `buffer` and `*needed` can be written.
enum CalibResult calib_camera_id(const struct CalibCamera *camera, char *buffer, size_t size, size_t *needed);

// Width and height of the still that was calibrated, in pixels.
//
// # Safety
// `camera` is a handle that is not freed meanwhile; `*width` and `*height` can be written.
enum CalibResult calib_camera_size(const struct CalibCamera *camera, uint32_t *width, uint32_t *height);

// x, y and z of the camera, three values, in metres.
//
// # Safety
// `camera` is a handle that is not freed meanwhile; three values of `position` can be written.
enum CalibResult calib_camera_position(const struct CalibCamera *camera, double *position);

// Yaw, pitch and roll, three values, in degrees: yaw counter-clockwise about the vertical, seen from above, 0 along y;
// pitch positive looking down; roll positive where the camera is turned clockwise, seen from behind.
//
// # Safety
// `camera` is a handle that is not freed meanwhile; three values of `degrees` can be written.
enum CalibResult calib_camera_angles(const struct CalibCamera *camera,
                                     double *degrees);

// Writes 1 into `*known` where something gives the scale of a camera: a height, a length, a distance, control points, or a
// place on the plan; 0 where nothing does: it is taken to be 3 m high, its metres are right in their proportions alone,
// and the calibration's part of every covariance is NaN.
//
// # Safety
// `camera` is a handle that is not freed meanwhile; `*known` can be written.
enum CalibResult calib_camera_scale_known(const struct CalibCamera *camera,
                                          uint8_t *known);

// The focal in pixels of the stream, one value; `CALIB_RESULT_REFUSED` where the stream is stretched and has no one focal.
//
// # Safety
// `camera` is a handle that is not freed meanwhile; `*focal_px` can be written.
enum CalibResult calib_camera_focal(const struct CalibCamera *camera,
                                    double *focal_px);

// K, nine values row by row: points of the camera's axes to undistorted pixels of the stream, as OpenCV takes it where
// the stream has `CALIB_ORIGIN_CENTRE`; `CALIB_RESULT_REFUSED` where the stream is stretched.
//
// # Safety
// `camera` is a handle that is not freed meanwhile; nine values of `matrix` can be written.
enum CalibResult calib_camera_matrix(const struct CalibCamera *camera,
                                     double *matrix);

// The distortion: the name of its model into `*model`, null where there is none, which nobody frees; five coefficients in
// the order of the model, zeros after its last; and the focal that they are for, in pixels of the stream.
//
// "brown-conrady" has k1, k2, k3, p1, p2 (OpenCV's order is k1, k2, p1, p2, k3), "division" lambda, "kannala-brandt" k1 to k4,
// "unified" xi, and "double-sphere" xi and alpha. `CALIB_RESULT_REFUSED` where the stream is stretched.
//
// # Safety
// `camera` is a handle that is not freed meanwhile; `*model`, five values of `coefficients` and `*focal_px` can be written.
enum CalibResult calib_camera_distortion(const struct CalibCamera *camera,
                                         const char **model,
                                         double *coefficients,
                                         double *focal_px);

// Covariance of the unknowns, `CALIB_UNKNOWNS` rows of as many values: x, y, z (metres), yaw, pitch, roll (radians), focal
// (pixels of the still), five coefficients of the distortion, of a fisheye the log of its own focal in place of the
// fifth, and the principal point, u and v (pixels of the still); zeros for what was not estimated, infinite variances where nothing is
// known of the errors, as of z where nothing gives the scale.
//
// # Safety
// `camera` is a handle that is not freed meanwhile; `CALIB_UNKNOWNS` squared values of `covariance` can be written.
enum CalibResult calib_camera_covariance(const struct CalibCamera *camera,
                                         double *covariance);

// Pixels to points of the plane `height_m` metres above the floor.
//
// All arrays have `count` values: pixels `u`, `v`; metres `x`, `y`, NaN where the pixel shows no point; and
// `status`, a `CALIB_STATUS`. Arrays that are written to overlap no other.
//
// # Safety
// `camera` is a handle that is not freed meanwhile; `count` values can be read of `u`, `v`, and written of `x`, `y`
// and `status`, and nobody else writes to them meanwhile.
enum CalibResult calib_camera_to_floor(const struct CalibCamera *camera,
                                       double height_m,
                                       size_t count,
                                       const double *u,
                                       const double *v,
                                       double *x,
                                       double *y,
                                       uint8_t *status);

// Boxes of a detector to the points of the plane on which their contents stand: the middle of the lower edge.
//
// `form` is a `CALIB_BOX`; `boxes` has four values for each of `count` boxes. The others are as for
// `calib_camera_to_floor`.
//
// # Safety
// As for `calib_camera_to_floor`; four times `count` values can be read of `boxes`.
enum CalibResult calib_camera_boxes_to_floor(const struct CalibCamera *camera,
                                             double height_m,
                                             uint32_t form,
                                             size_t count,
                                             const double *boxes,
                                             double *x,
                                             double *y,
                                             uint8_t *status);

// How uncertain the points are that pixels show, for a standard deviation of `sigma_px` pixels of the stream.
//
// `pixel` and `calibration` get four values for each of `count` pixels: the covariances xx, xy, yx, yy in square
// metres. The pixel's part is independent from detection to detection; the calibration's is common to all of a
// camera, so that a filter must not average it away. NaN where there is no point, and in `calibration` where
// nothing is known of its errors, or nothing gives its scale (`calib_camera_scale_known`).
//
// # Safety
// `camera` is a handle that is not freed meanwhile; `count` values can be read of `u`, `v`, and four times as many
// written of `pixel` and `calibration`, and nobody else writes to them meanwhile.
enum CalibResult calib_camera_floor_covariance(const struct CalibCamera *camera,
                                               double height_m,
                                               double sigma_px,
                                               size_t count,
                                               const double *u,
                                               const double *v,
                                               double *pixel,
                                               double *calibration);

// How uncertain the points are on which the contents of boxes stand, for a standard deviation of `sigma_px` pixels of
// each coordinate of the middle of their lower edges.
//
// `form` and `boxes` are as for `calib_camera_boxes_to_floor`, the others as for `calib_camera_floor_covariance`.
//
// # Safety
// As for `calib_camera_floor_covariance`; four times `count` values can be read of `boxes`.
enum CalibResult calib_camera_boxes_covariance(const struct CalibCamera *camera,
                                               double height_m,
                                               double sigma_px,
                                               uint32_t form,
                                               size_t count,
                                               const double *boxes,
                                               double *pixel,
                                               double *calibration);

// Derivatives of the floor points of pixels by the unknowns of the camera, as a filter needs that considers the errors
// of the calibration: their covariance is `calib_camera_covariance`.
//
// `jacobian` gets twice `CALIB_UNKNOWNS` values for each of `count` pixels: those of x, then those of y, in metres per
// unit of the unknown; NaN where there is no floor point.
//
// # Safety
// As for `calib_camera_to_floor`; twice `CALIB_UNKNOWNS` times `count` values can be written of `jacobian`.
enum CalibResult calib_camera_floor_jacobian(const struct CalibCamera *camera,
                                             size_t count,
                                             const double *u,
                                             const double *v,
                                             double *jacobian);

// Points of space, in metres, to pixels.
//
// All arrays have `count` values; `u` and `v` are NaN where the camera cannot show the point, and `status`, a
// `CALIB_STATUS`, says why.
//
// # Safety
// As for `calib_camera_to_floor`.
enum CalibResult calib_camera_to_pixel(const struct CalibCamera *camera,
                                       size_t count,
                                       const double *x,
                                       const double *y,
                                       const double *z,
                                       double *u,
                                       double *v,
                                       uint8_t *status);

// The rays that pixels show: `directions` gets three values for each of `count` pixels, a unit vector in the axes
// of the site; NaN outside the lens.
//
// # Safety
// As for `calib_camera_to_floor`; three times `count` values can be written of `directions`.
enum CalibResult calib_camera_rays(const struct CalibCamera *camera,
                                   size_t count,
                                   const double *u,
                                   const double *v,
                                   double *directions);

// Where a camera of the same focal without distortion would show what this one shows at pixels; NaN outside the
// lens.
//
// # Safety
// As for `calib_camera_to_floor`.
enum CalibResult calib_camera_undistort(const struct CalibCamera *camera,
                                        size_t count,
                                        const double *u,
                                        const double *v,
                                        double *to_u,
                                        double *to_v);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* CALIB_H */
