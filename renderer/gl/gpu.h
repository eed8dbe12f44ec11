/*
 * OpenGL 3.3 core: a context without a window, shader programs, textures and render targets, with
 * OpenGL errors as GErrors. Everything belongs to the thread in which the context was made.
 */
#pragma once

#include <glib.h>

#define GPU_ERROR gpu_error_quark()
GQuark gpu_error_quark(void);
enum gpu_error {
    GPU_ERROR_NONE,      /* there is no OpenGL 3.3 here */
    GPU_ERROR_TOO_LARGE, /* the card cannot hold it */
    GPU_ERROR_PROGRAM,   /* a shader was refused */
    GPU_ERROR_FAILED,    /* OpenGL reported an error */
};

typedef struct Gpu Gpu;

/* Whether the OpenGL library is installed; window: the one that libepoxy needs for a window.
 * Without it, libepoxy would end the program at the first call. */
gboolean gpu_find_library(gboolean window, GError **error);

/* Makes a context current through EGL without a surface (Mesa, or the platform of a graphics card).
 */
Gpu *gpu_new_headless(GError **error);
void gpu_free(Gpu *gpu); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Gpu, gpu_free)

/* In debug builds (GPU_DEBUG): each OpenGL error of the current context is a critical message, at
 * the call that makes it. gpu_new_headless() does this. */
void gpu_watch(void);

const char *gpu_renderer(void); /* of the current context, never NULL */

/* Fails if OpenGL has an error pending. what: the operation, for the message. */
gboolean gpu_check(const char *what, GError **error);

/* names: of embedded shaders, NULL-ended; the vertex shader first, all others are joined to one
 * fragment shader. constants: lines “#define NAME value” that come before them, or "". Returns 0 on
 * error. */
guint gpu_program(const char *constants, const char *const *names, GError **error);

/* Does the same in the language of OpenGL 4.3, if gpu_has_43(). */
guint gpu_program_43(const char *constants, const char *const *names, GError **error);
gboolean gpu_has_43(void);

/* Draws the triangle of screen.vert, which covers the screen. */
void gpu_fill_screen(void);

/* A texture with its format's storage; layers 0: 2D, else a 2D array. Clamped and unfiltered. */
guint gpu_texture(int internal_format, int width, int height, int layers);
/* The same as a 2D array with n_levels mip levels; each has half the width and height, at least 1.
 */
guint gpu_texture_levels(int internal_format, int width, int height, int layers, int n_levels);

/* Binds texture (0: none) to a texture unit and makes it the sampler NAME of a program in use. Unit
 * 0 is active afterwards. target: a GL_TEXTURE_…. */
void gpu_bind_texture(guint program, const char *name, int unit, guint target, guint texture);

/* Bytes of all levels that a texture has, from the format that OpenGL reports; 0 for texture 0.
 * target: a GL_TEXTURE_…. */
gint64 gpu_texture_bytes(guint target, guint texture);

/* Columns and rows of a level of a texture. */
void gpu_texture_size(guint target, guint texture, int level, int ret[2]);

/* A colour texture with or without a depth buffer to draw into. */
struct gpu_target {
    guint framebuffer, colour, depth;
    int width, height;
};

gboolean gpu_target_resize(struct gpu_target *target, int width, int height, int internal_format,
                           gboolean depth, GError **error);
void gpu_target_clear(struct gpu_target *target);

/* The picture drawn: width × height × 3 bytes, top row first; g_free(). */
guint8 *gpu_target_read(const struct gpu_target *target, GError **error);

/* Flips a picture vertically, in place. stride: bytes per row. */
void gpu_flip_rows(void *picture, gsize stride, int height);
