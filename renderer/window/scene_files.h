/* The files of a scene of several materials (--material): its mesh, materials and MDFs. */
#pragma once

#include "scene/reference.h"
#include "viewer_options.h"

/* As scene_make(); with --material the options' own shape is read by scene_read_parts(). */
struct mesh *scene_files_mesh(const struct viewer_options *options, const char *shape,
                              const struct scene_options *how, GError **error);

/* Adds the materials of --material to a viewer; a session is drawn by the method, if it can draw
 * sessions. relief: adds the materials' MDFs, too, if they have any. */
gboolean scene_files_open(const struct viewer_options *options, const struct method *method,
                          gboolean relief, Viewer *viewer, GError **error);

/* The whole BTF of a session, or a compressed file. */
Reference *scene_files_reference(const char *path, GError **error);
