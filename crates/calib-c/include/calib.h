/* Calibrated cameras: map pixels of detectors to metres on the floor, and back.
 *
 * Lengths are in metres, with z up and the floor at z = 0. Pixels count from the corner of the image, x right and y
 * down, unless a CalibStream selects another origin. There is no state outside of handles. Any number of threads may
 * use a handle at once. Free each handle once, after its last use.
 */

#ifndef CALIB_H
#define CALIB_H

#include <stddef.h>
#include <stdint.h>

// Pixels count from the corner of the image: the centre of the first pixel is (0.5, 0.5).
#define CALIB_ORIGIN_CORNER 0

// Pixels count from the centre of the first pixel, as in OpenCV.
#define CALIB_ORIGIN_CENTRE 1

// No fit is selected. The call fails if the stream and the image have different aspect ratios.
#define CALIB_FIT_UNSAID 0

// The width and the height of the image are scaled by different factors, so that the image fills the stream.
#define CALIB_FIT_STRETCH 1

// Width and height of the image have the same scale, with equal bars on two sides of the stream.
#define CALIB_FIT_LETTERBOX 2

// Box as upper left corner, width and height.
#define CALIB_BOX_CORNER_SIZE 0

// Box as upper left and lower right corner.
#define CALIB_BOX_CORNERS 1

// Box as centre, width and height.
#define CALIB_BOX_CENTRE_SIZE 2

// Box as centre, width and height, as fractions of the width and height of the stream (YOLO).
#define CALIB_BOX_FRACTIONS 3

// Mapped; inside the effective field of view (EFOV), or, for world points, inside the image.
#define CALIB_STATUS_OK 0

// No result: the pixel shows no point of the plane.
#define CALIB_STATUS_ABOVE_HORIZON 1

// Mapped, but outside the effective field of view.
#define CALIB_STATUS_OUTSIDE_EFOV 2

// Mapped, but outside the image.
#define CALIB_STATUS_OUTSIDE_IMAGE 3

// No result: outside the range of the lens model.
#define CALIB_STATUS_OUTSIDE_LENS 4

// No result: the point is not in front of the camera.
#define CALIB_STATUS_BEHIND_CAMERA 5

// No result: a coordinate is not finite.
#define CALIB_STATUS_MISSING 6

// No result: the camera has no calibration.
#define CALIB_STATUS_NO_CALIBRATION 7

// No result: the pixel shows the wall of a pit, between its plane and the floor.
#define CALIB_STATUS_ON_WALL 8

// Largest number of distortion coefficients of a model.
#define CALIB_COEFFICIENTS 12

// Number of parameters of a camera: x, y, z, yaw, pitch, roll, focal length, five distortion coefficients, the
// principal point (two) and the pixel aspect.
#define CALIB_UNKNOWNS 15

// Result of a call.
typedef enum CalibResult {
  // Success.
  CALIB_RESULT_OK = 0,
  // A required pointer is null.
  CALIB_RESULT_NULL = 1,
  // A pointer is not aligned for its type.
  CALIB_RESULT_MISALIGNED = 2,
  // An output array overlaps another array.
  CALIB_RESULT_OVERLAP = 3,
  // A buffer is too small. The required size is returned, and the buffer is unchanged.
  CALIB_RESULT_SHORT = 4,
  // A text is not valid UTF-8.
  CALIB_RESULT_NOT_TEXT = 5,
  // A value is invalid, or the requested property does not exist. The error message, if the call has one, contains
  // the reason.
  CALIB_RESULT_REFUSED = 6,
  // Internal error of this library: please report it.
  CALIB_RESULT_PANICKED = 7,
} CalibResult;

// Calibrated camera. Any number of threads may use it at once.
typedef struct CalibCamera CalibCamera;

// Site with its cameras. Any number of threads may use it at once.
typedef struct CalibSite CalibSite;

// Stream that pixels refer to. All zeros select the calibrated image.
typedef struct CalibStream {
  // Pixel origin: `CALIB_ORIGIN_CORNER` or `CALIB_ORIGIN_CENTRE`.
  uint32_t origin;
  // Fit of the image to the stream: `CALIB_FIT_UNSAID`, `CALIB_FIT_STRETCH` or `CALIB_FIT_LETTERBOX`. If the
  // stream and the image have different aspect ratios, `CALIB_FIT_STRETCH` or `CALIB_FIT_LETTERBOX` is required.
  uint32_t fit;
  // Width, in pixels. If width and height are 0, the stream has the size of the image or its crop.
  uint32_t width;
  // Height, in pixels.
  uint32_t height;
  // Part of the image that the stream shows: left, top, width and height, in pixels of the calibrated
  // image. Four zeros select the whole image.
  double crop[4];
} CalibStream;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// Returns the version of this library as text.
const char *calib_version(void);

// Returns a description of a `CalibResult`, or "unknown result" for any other value.
const char *calib_result_text(int32_t result);

// Returns the name of a `CALIB_STATUS`, such as "above-horizon", or null for any other value.
const char *calib_status_name(uint8_t status);

// Parses a site document of `length` bytes of JSON text.
//
// `*site` receives a handle, to be freed by `calib_site_free`. On failure a message is written to `error`,
// cut to `error_size` bytes. `error` may be null.
//
// # Safety
// `length` bytes of `json` can be read. `*site` and `error_size` bytes of `error` can be written.
enum CalibResult calib_site_parse(const char *json,
                                  size_t length,
                                  struct CalibSite **site,
                                  char *error,
                                  size_t error_size);

// Calibrates a site from its annotations and entered values.
//
// `*solved` receives a new handle of the site with its solutions, to be freed by `calib_site_free`. A camera that
// cannot be solved does not prevent the others from being solved; its entry contains the reason.
//
// # Safety
// `site` is a handle that is not freed during the call, and `*solved` can be written.
enum CalibResult calib_site_calibrate(const struct CalibSite *site,
                                      struct CalibSite **solved);

// Writes a site as zero-terminated JSON text into `buffer`, and the required size in bytes into `*needed`.
//
// `size` is the size of `buffer`. `needed` may be null. Call with a size of 0 to get the required size.
//
// # Safety
// `site` is a handle that is not freed during the call. `size` bytes of `buffer` and `*needed` can be
// written.
enum CalibResult calib_site_json(const struct CalibSite *site, char *buffer, size_t size, size_t *needed);

// Writes the number of camera entries, calibrated or not, into `*count`.
//
// # Safety
// `site` is a handle that is not freed during the call, and `*count` can be written.
enum CalibResult calib_site_camera_count(const struct CalibSite *site, size_t *count);

// Writes the id of the camera entry `index`. Buffer and size work as in `calib_site_json`.
//
// # Safety
// `site` is a handle that is not freed during the call. `size` bytes of `buffer` and `*needed` can be
// written.
enum CalibResult calib_site_camera_id(const struct CalibSite *site,
                                      size_t index,
                                      char *buffer,
                                      size_t size,
                                      size_t *needed);

// Frees a site. Null is allowed.
//
// # Safety
// `site` is null, or a handle that is not used any more.
void calib_site_free(struct CalibSite *site);

// Creates a handle of a calibrated camera.
//
// `at` is a time such as "2026-05-01T08:00:00Z". It is required if the id has several periods, and may be null
// otherwise. All calls with this camera use pixels of `stream`. Null selects the calibrated image, with pixels
// counted from its corner.
//
// `*camera` receives a handle, to be freed by `calib_camera_free`. The handle stays valid after the site is freed.
// On failure a message is written to `error`, cut to `error_size` bytes. `error` may be null.
//
// # Safety
// `site` is a handle that is not freed during the call. `id` and `at` end with a zero. `*stream` can be
// read. `*camera` and `error_size` bytes of `error` can be written.
enum CalibResult calib_site_camera(const struct CalibSite *site,
                                   const char *id,
                                   const char *at,
                                   const struct CalibStream *stream,
                                   struct CalibCamera **camera,
                                   char *error,
                                   size_t error_size);

// Frees a camera. Null is allowed.
//
// # Safety
// `camera` is null, or a handle that is not used any more.
void calib_camera_free(struct CalibCamera *camera);

// Writes the width of a plan pixel, in metres. Returns `CALIB_RESULT_REFUSED` if the site has no plan.
//
// # Safety
// `site` is a handle that is not freed during the call, and `*metres` can be written.
enum CalibResult calib_site_plan_metres_per_px(const struct CalibSite *site, double *metres);

// Converts floor points, in metres, to pixels of the plan from its upper left corner, y down.
//
// All arrays have `count` values. Output arrays overlap no other array. Returns `CALIB_RESULT_REFUSED` if
// the site has no plan.
//
// # Safety
// `site` is a handle that is not freed during the call. `count` values of `x`, `y` can be read. `count`
// values of `px`, `py` can be written, and no other thread accesses them during the call.
enum CalibResult calib_site_floor_to_plan(const struct CalibSite *site,
                                          size_t count,
                                          const double *x,
                                          const double *y,
                                          double *px,
                                          double *py);

// Converts pixels of the plan to floor points, in metres: the inverse of `calib_site_floor_to_plan`.
//
// # Safety
// As for `calib_site_floor_to_plan`.
enum CalibResult calib_site_plan_to_floor(const struct CalibSite *site,
                                          size_t count,
                                          const double *px,
                                          const double *py,
                                          double *x,
                                          double *y);

// Writes the id of a camera. Buffer and size work as in `calib_site_json`.
//
// # Safety
// `camera` is a handle that is not freed during the call. `size` bytes of `buffer` and `*needed` can be
// written.
enum CalibResult calib_camera_id(const struct CalibCamera *camera, char *buffer, size_t size, size_t *needed);

// Writes width and height of the calibrated image, in pixels.
//
// # Safety
// `camera` is a handle that is not freed during the call. `*width` and `*height` can be written.
enum CalibResult calib_camera_size(const struct CalibCamera *camera, uint32_t *width, uint32_t *height);

// Writes the position of the camera: x, y, z in metres.
//
// # Safety
// `camera` is a handle that is not freed during the call. Three values of `position` can be written.
enum CalibResult calib_camera_position(const struct CalibCamera *camera, double *position);

// Writes yaw, pitch and roll, in degrees. Yaw counts counter-clockwise seen from above, and 0 looks along y.
// A positive pitch looks down. A positive roll is clockwise, seen from behind the camera.
//
// # Safety
// `camera` is a handle that is not freed during the call. Three values of `degrees` can be written.
enum CalibResult calib_camera_angles(const struct CalibCamera *camera, double *degrees);

// Writes 1 into `*known` if a height, a length, a distance, control points or a placement on the plan
// determine the scale. Otherwise writes 0: the camera is assumed to be 3 m high, its metres have an unknown
// common factor, and the calibration's part of every covariance is NaN.
//
// # Safety
// `camera` is a handle that is not freed during the call. `*known` can be written.
enum CalibResult calib_camera_scale_known(const struct CalibCamera *camera, uint8_t *known);

// Writes the focal length, in pixels of the stream. Returns `CALIB_RESULT_REFUSED` for a stretched stream,
// which has two focal lengths.
//
// # Safety
// `camera` is a handle that is not freed during the call. `*focal_px` can be written.
enum CalibResult calib_camera_focal(const struct CalibCamera *camera, double *focal_px);

// Writes the camera matrix K, nine values row by row: camera coordinates to undistorted pixels of the
// stream. It is OpenCV's matrix if the stream has `CALIB_ORIGIN_CENTRE` and square pixels. Returns
// `CALIB_RESULT_REFUSED` for a stretched stream.
//
// # Safety
// `camera` is a handle that is not freed during the call. Nine values of `matrix` can be written.
enum CalibResult calib_camera_matrix(const struct CalibCamera *camera, double *matrix);

// Writes the distortion: the name of its model, `CALIB_COEFFICIENTS` coefficients, and the focal length of
// the coefficients, in pixels of the stream.
//
// `*model` is a static string, or null without distortion. Coefficients are in the order of the model,
// followed by zeros. "brown-conrady" has k1, k2, k3, p1, p2 (OpenCV's order is k1, k2, p1, p2, k3),
// "division" lambda, "kannala-brandt" k1 to k4, "unified" xi, k1, k2, p1, p2, "double-sphere" xi and alpha,
// "eucm" alpha and beta, and "rational" k1 to k6, p1, p2, s1 to s4. Returns `CALIB_RESULT_REFUSED` for a
// stretched stream.
//
// # Safety
// `camera` is a handle that is not freed during the call. `*model`, `CALIB_COEFFICIENTS` values of
// `coefficients` and `*focal_px` can be written.
enum CalibResult calib_camera_distortion(const struct CalibCamera *camera,
                                         const char **model,
                                         double *coefficients,
                                         double *focal_px);

// Writes the covariance of the camera's parameters, a square matrix with `CALIB_UNKNOWNS` rows.
//
// The parameters are x, y, z (metres), yaw, pitch, roll (radians), and focal length (pixels of the calibrated
// image). Five distortion coefficients follow in the order of their model, then the principal point u, v (pixels of
// the calibrated image) and the pixel aspect. For a fisheye the fifth distortion parameter is the logarithm of the
// lens's focal length. Rows of fixed parameters are 0. A variance is infinite if it is unknown, for example of z
// without a known scale.
//
// # Safety
// `camera` is a handle that is not freed during the call. `CALIB_UNKNOWNS` squared values of `covariance`
// can be written.
enum CalibResult calib_camera_covariance(const struct CalibCamera *camera,
                                         double *covariance);

// Maps pixels to points of the plane `height_m` metres above the floor.
//
// All arrays have `count` values: pixels `u`, `v`; metres `x`, `y`, NaN without a point; and `status`, a
// `CALIB_STATUS`. Output arrays overlap no other array.
//
// # Safety
// `camera` is a handle that is not freed during the call. `count` values of `u`, `v` can be read. `count`
// values of `x`, `y` and `status` can be written, and no other thread accesses them during the call.
enum CalibResult calib_camera_to_floor(const struct CalibCamera *camera,
                                       double height_m,
                                       size_t count,
                                       const double *u,
                                       const double *v,
                                       double *x,
                                       double *y,
                                       uint8_t *status);

// Maps boxes of a detector to points of the plane `height_m` metres above the floor. The foot point of a box is the
// middle of its lower edge.
//
// `form` is a `CALIB_BOX`, and `boxes` contains four values for each of `count` boxes. Other arguments are
// as for `calib_camera_to_floor`.
//
// # Safety
// As for `calib_camera_to_floor`. Four times `count` values of `boxes` can be read.
enum CalibResult calib_camera_boxes_to_floor(const struct CalibCamera *camera,
                                             double height_m,
                                             uint32_t form,
                                             size_t count,
                                             const double *boxes,
                                             double *x,
                                             double *y,
                                             uint8_t *status);

// Computes the covariance of the points that pixels show on the plane `height_m` metres above the floor. The
// standard deviation of a pixel coordinate is `sigma_px` pixels of the stream.
//
// `pixel` and `calibration` receive four values for each of `count` pixels: xx, xy, yx, yy in square metres.
// The pixel part is independent between detections. The calibration part is common to all detections of a camera, so
// a filter must not average it away. Both are NaN without a point. `calibration` is also NaN if the errors of the
// calibration or its scale (`calib_camera_scale_known`) are unknown.
//
// # Safety
// `camera` is a handle that is not freed during the call. `count` values of `u`, `v` can be read. Four times
// `count` values of `pixel` and `calibration` can be written, and no other thread accesses them during the
// call.
enum CalibResult calib_camera_floor_covariance(const struct CalibCamera *camera,
                                               double height_m,
                                               double sigma_px,
                                               size_t count,
                                               const double *u,
                                               const double *v,
                                               double *pixel,
                                               double *calibration);

// Computes the covariance of the points of boxes on the plane `height_m` metres above the floor. The standard
// deviation of each coordinate of the foot point is `sigma_px` pixels of the stream.
//
// `form` and `boxes` are as for `calib_camera_boxes_to_floor`, other arguments as for
// `calib_camera_floor_covariance`.
//
// # Safety
// As for `calib_camera_floor_covariance`. Four times `count` values of `boxes` can be read.
enum CalibResult calib_camera_boxes_covariance(const struct CalibCamera *camera,
                                               double height_m,
                                               double sigma_px,
                                               uint32_t form,
                                               size_t count,
                                               const double *boxes,
                                               double *pixel,
                                               double *calibration);

// Computes the Jacobian of floor points with respect to the parameters of the camera.
//
// A Schmidt-Kalman filter uses it to include the errors of the calibration, whose covariance is
// `calib_camera_covariance`. `jacobian` receives twice `CALIB_UNKNOWNS` values for each of `count` pixels:
// the row of x, then the row of y, in metres per unit of the parameter. They are NaN without a floor point.
//
// # Safety
// As for `calib_camera_to_floor`. Twice `CALIB_UNKNOWNS` times `count` values of `jacobian` can be written.
enum CalibResult calib_camera_floor_jacobian(const struct CalibCamera *camera,
                                             size_t count,
                                             const double *u,
                                             const double *v,
                                             double *jacobian);

// Projects world points, in metres, to pixels.
//
// All arrays have `count` values. `u` and `v` are NaN if the camera cannot show the point. `status`, a
// `CALIB_STATUS`, contains the reason.
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

// Computes the viewing rays of pixels. `directions` receives three values for each of `count` pixels: a unit
// vector in the axes of the site, NaN outside the lens.
//
// # Safety
// As for `calib_camera_to_floor`. Three times `count` values of `directions` can be written.
enum CalibResult calib_camera_rays(const struct CalibCamera *camera,
                                   size_t count,
                                   const double *u,
                                   const double *v,
                                   double *directions);

// Undistorts pixels: writes their position in a camera with the same focal length and no distortion, NaN
// outside the lens.
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
