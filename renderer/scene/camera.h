/* Where the camera of a view stands. */
#pragma once

#include "viewer.h"

/* column-major, of world coordinates; aspect: width / height. What lies within reach of the origin
 * is drawn. */
void camera_matrix(const struct viewer_settings *settings, double radius, double reach,
                   double aspect, float ret_projection[16], float ret_eye[3]);

/* Stands so near, and so far aside, that all points (n × 3) just fill the picture, with a margin;
 * sets distance and pan. */
void camera_fit(struct viewer_settings *settings, const float *points, guint n, double radius,
                double aspect);
