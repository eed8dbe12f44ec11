/*
 * The tasks of pictures on request (web_task.h). The name of a task is that of the camera in the
 * rig file. The server keeps the last picture only, with the values of the sensor. It takes one
 * picture at a time, because a picture may have many megabytes. Reading, measuring and encoding
 * are done in a thread, so that other requests are answered meanwhile.
 */
#pragma once

#include "web_task.h"

#define WEB_SNAPS_SIDE   1024 /* maximum width and height of the whole picture in pixels */
#define WEB_SNAPS_PIXELS 128  /* width and height of the part that is shown pixel by pixel */

WebSnaps *web_snaps_new(void);
void web_snaps_unref(WebSnaps *snaps);

/* Takes a picture. The query has the exposure: exposure_us=10000. If another picture is being
 * taken, answers the task with the status 409. The answer has the values of picture_values.h as
 * numbers of the sensor (openapi.json: Snap). */
void web_snaps_take(const struct web_task *task);

/* Answers with the last picture as PNG, if it is of this camera: 8 bits, sRGB, the 99th percentile
 * is white. */
void web_snaps_png(const struct web_task *task);

/* Answers with a part of the last picture, WEB_SNAPS_PIXELS wide and high. Each pixel of the sensor
 * is one grey pixel, with the same white as in the whole picture; saturated pixels are red. The
 * query has the upper left corner of the part in pixels of the sensor: x=0&y=0. A part that would
 * reach beyond the picture is moved into the picture. */
void web_snaps_pixels(const struct web_task *task);
