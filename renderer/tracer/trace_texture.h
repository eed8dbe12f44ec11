/*
 * A picture on a surface: PNG or JPEG, decoded to linear light, bilinear between its pixels,
 * repeated, mirrored or held beyond its edges as glTF's samplers say. Any thread, once it is made.
 */
#pragma once

#include <glib.h>

#include "shapes/gltf_scene.h"

#define TRACE_TEXTURE_MAX_SIDE 16384

typedef struct trace_texture TraceTexture;

/* bytes: a PNG of any kind, whose alpha is left out, or a JPEG, grey or in colour.
 * TRACE_ERROR_SCENE: it is another format, damaged, or larger than TRACE_TEXTURE_MAX_SIDE each way.
 */
TraceTexture *trace_texture_new(GBytes *bytes, const enum gltf_wrap wrap[2], GError **error);
void trace_texture_free(TraceTexture *texture); /* NULL is ignored */

/* At texture coordinates of which v runs upwards from the lowest row, as the tracer's do. */
void trace_texture_colour(const TraceTexture *texture, double u, double v, double ret_rgb[3]);
