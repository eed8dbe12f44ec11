/*
 * OpenGL 3.3 core: a context without a window, shader programs, textures and render targets. OpenGL
 * errors are reported as GErrors. All functions belong to the thread in which the context was made.
 */
#pragma once

#include <glib.h>

#define GPU_ERROR gpu_error_quark()
GQuark gpu_error_quark(void);
enum gpu_error {
    /* there is no window, or OpenGL is older than 3.3; lists of faces need OpenGL 4.3 */
    GPU_ERROR_NONE,
    GPU_ERROR_TOO_LARGE, /* the card cannot hold the data, or a limit of the program is exceeded */
    GPU_ERROR_PROGRAM,   /* the driver refused a shader */
    GPU_ERROR_FAILED,    /* OpenGL reported an error, or a file or an option cannot be used */
};

typedef struct Gpu Gpu;

/* Returns whether the OpenGL library is installed. If window is TRUE, looks only for libGL.so.1,
 * which libepoxy needs for a window. Without the library, libepoxy would end the process at the
 * first call. */
gboolean gpu_find_library(gboolean window, GError **error);

/* Makes an OpenGL context through EGL (Mesa, or the EGL platform of a graphics card), without a
 * window, and makes it current. Returns NULL on error. */
Gpu *gpu_new_headless(GError **error);
/* Frees the context. No context is current afterwards. NULL is ignored. */
void gpu_free(Gpu *gpu);
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Gpu, gpu_free)

/* In debug builds (GPU_DEBUG), each OpenGL error of the current context becomes a critical message
 * at the call that causes it. gpu_new_headless() calls this function. */
void gpu_watch(void);

const char *gpu_renderer(void); /* name of the renderer of the current context, never NULL */

/* Returns FALSE with an error if OpenGL has reported an error since the last check. The error is
 * GPU_ERROR_TOO_LARGE if the card has no memory left, otherwise GPU_ERROR_FAILED. what names the
 * operation in the message. */
gboolean gpu_check(const char *what, GError **error);

/* Compiles and links a program. Delete it with glDeleteProgram(). Returns 0 with GPU_ERROR_PROGRAM
 * on error.
 *
 * names is a NULL-terminated list of embedded shaders. The first is the vertex shader. The other
 * shaders, at most 14, are joined to one fragment shader. The process is aborted if there is no
 * embedded shader of a name. constants has lines “#define NAME value”, which are put before the
 * shaders; it may be "". */
guint gpu_program(const char *constants, const char *const *names, GError **error);

/* Does the same as gpu_program() in the shading language of OpenGL 4.3. Requires gpu_has_43(). */
guint gpu_program_43(const char *constants, const char *const *names, GError **error);
gboolean gpu_has_43(void); /* whether the current context has OpenGL 4.3 or later */

/* Draws the triangle of screen.vert, which covers the whole screen. */
void gpu_fill_screen(void);

/* Returns a new texture with undefined contents. It is a 2D texture if layers is 0, and otherwise a
 * 2D array. The texture is clamped and unfiltered, and stays bound. Delete it with
 * glDeleteTextures(). */
guint gpu_texture(int internal_format, int width, int height, int layers);
/* Does the same as gpu_texture(), for a 2D array with n_levels mip levels. Each level has half the
 * width and height of the level before, but at least 1 texel. */
guint gpu_texture_levels(int internal_format, int width, int height, int layers, int n_levels);

/* Binds a texture (0 for none) to a texture unit and makes it the sampler `name` of a program in
 * use. target is a GL_TEXTURE_…. Unit 0 is active afterwards. */
void gpu_bind_texture(guint program, const char *name, int unit, guint target, guint texture);

/* Returns the number of bytes of all levels of a texture, computed from the format that OpenGL
 * reports. Returns 0 for texture 0. target is a GL_TEXTURE_…. The texture stays bound. */
gint64 gpu_texture_bytes(guint target, guint texture);

/* Returns the width and height in texels of a level of a texture. The texture stays bound. */
void gpu_texture_size(guint target, guint texture, int level, int ret[2]);

/* A framebuffer with a colour texture, and with or without a depth texture. All members are 0
 * before the first gpu_target_resize(). */
struct gpu_target {
    guint framebuffer, colour, depth;
    int width, height;
};

/* Makes textures of this size. Does nothing if the target already has this size, even if its format
 * is another one. The contents of new textures are undefined. The framebuffer stays bound. Fails if
 * the card does not support the size or cannot draw into the format. After an error the target is
 * as after gpu_target_clear(). */
gboolean gpu_target_resize(struct gpu_target *target, int width, int height, int internal_format,
                           gboolean depth, GError **error);
/* Deletes the framebuffer and the textures, and sets all members to 0. */
void gpu_target_clear(struct gpu_target *target);

/* Returns the picture as width × height × R, G, B bytes, top row first; g_free(). Returns NULL on
 * error. The framebuffer stays bound. */
guint8 *gpu_target_read(const struct gpu_target *target, GError **error);

/* Flips a picture vertically, in place. stride is the number of bytes per row. */
void gpu_flip_rows(void *picture, gsize stride, int height);
