/* Probe of a GStreamer pad that maps the regions of interest of a detector to the floor. Detectors add a
 * GstVideoRegionOfInterestMeta to every buffer. A DeepStream probe does the same with rect_params of NvDsObjectMeta.
 *
 *     CalibProbe probe = {camera, print_point};
 *     gst_pad_add_probe(pad, GST_PAD_PROBE_TYPE_BUFFER, calib_probe, &probe, NULL);
 *
 * Create the camera with a CalibStream of the size in the pad's caps.
 */

#include <gst/gst.h>
#include <gst/video/gstvideometa.h>

#include "calib.h"

typedef struct CalibProbe {
    const CalibCamera *camera;
    void (*seen)(guint64 pts_ns, gint id, double x_m, double y_m, uint8_t status);
} CalibProbe;

GstPadProbeReturn calib_probe(GstPad *pad, GstPadProbeInfo *info, gpointer data);

GstPadProbeReturn calib_probe(GstPad *pad, GstPadProbeInfo *info, gpointer data)
{
    const CalibProbe *probe = data;
    GstBuffer *buffer = GST_PAD_PROBE_INFO_BUFFER(info);
    gpointer state = NULL;
    GstMeta *meta;
    (void)pad;
    while ((meta = gst_buffer_iterate_meta_filtered(buffer, &state, GST_VIDEO_REGION_OF_INTEREST_META_API_TYPE))) {
        const GstVideoRegionOfInterestMeta *region = (const GstVideoRegionOfInterestMeta *)meta;
        const double box[4] = {region->x, region->y, region->w, region->h};
        double x, y;
        uint8_t status;
        if (calib_camera_boxes_to_floor(probe->camera, 0.0, CALIB_BOX_CORNER_SIZE, 1, box, &x, &y, &status) ==
            CALIB_RESULT_OK) {
            probe->seen(GST_BUFFER_PTS(buffer), region->id, x, y, status);
        }
    }
    return GST_PAD_PROBE_OK;
}
