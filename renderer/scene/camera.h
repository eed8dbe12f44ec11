/* The camera of a picture: its matrix, and its distance from a mesh. */
#pragma once

#include "viewer_settings.h"

/* Computes ret_projection, the column-major matrix from world to clip coordinates, and ret_eye, the
 * position of the camera in world coordinates. radius is the radius of the mesh, which is the unit
 * of lengths in the settings. aspect is width / height.
 *
 * The near and far planes enclose the sphere of radius `reach` around the origin. The near plane is
 * at least 0.01 radius in front of the camera, even if it then cuts this sphere. */
void camera_matrix(const struct viewer_settings *settings, double radius, double reach,
                   double aspect, float ret_projection[16], float ret_eye[3]);

/* Sets camera_distance (0.01 … 1000) and camera_pan so that all points (n × 3) just fit into the
 * picture, with a margin. Changes nothing if n is 0. */
void camera_fit(struct viewer_settings *settings, const float *points, guint n, double radius,
                double aspect);
