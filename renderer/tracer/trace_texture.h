/*
 * A picture on a surface: a PNG or JPEG, decoded to linear light. It is interpolated bilinearly.
 * Beyond its edges, it is repeated, mirrored or clamped as the sampler of the glTF file says. Any
 * thread may read a texture after it was made.
 */
#pragma once

#include <glib.h>

#include "shapes/gltf_scene.h"

#define TRACE_TEXTURE_MAX_SIDE 16384

typedef struct trace_texture TraceTexture;

/* Makes a texture. bytes is a PNG, or a JPEG in grey or colour. The alpha of a PNG is ignored.
 * Fails with TRACE_ERROR_SCENE if the picture has another format, is damaged, or has a side longer
 * than TRACE_TEXTURE_MAX_SIDE pixels. */
TraceTexture *trace_texture_new(GBytes *bytes, const enum gltf_wrap wrap[2], GError **error);
void trace_texture_free(TraceTexture *texture); /* NULL is ignored */

/* Sets ret_rgb to the linear colour at the texture coordinates (u, v). As elsewhere in the tracer,
 * v increases upwards from the lowest row. */
void trace_texture_colour(const TraceTexture *texture, double u, double v, double ret_rgb[3]);
