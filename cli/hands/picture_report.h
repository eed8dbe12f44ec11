/* Describes a camera's frame, and writes the frame to a file. */
#pragma once

#include "capture/picture_values.h"
#include "common/record.h"
#include "drivers/frame.h"

/* Adds the values of a frame to the record, with a text of three lines. */
void picture_report_tell(Record *to, const char *camera, const Frame *frame,
                         const struct picture_values *report);

/* Writes a picture. A .png file has 8 bits, in sRGB with the 99th percentile as white. An .exr file
 * has the sensor's values in DN. */
gboolean picture_write(const char *path, const char *camera, const Frame *frame, GError **error);
