#include "gpu.h"
#include "shaders.h"

#include <dlfcn.h>
#include <epoxy/egl.h>
#include <epoxy/gl.h>
#include <string.h>

G_DEFINE_QUARK(gpu_error, gpu_error)

struct Gpu {
    EGLDisplay display;
    EGLContext context;
};

/* Returns an initialised EGL display, or EGL_NO_DISPLAY. The display is never terminated, because
 * all contexts of the process share it. */
static EGLDisplay open_display(void) {
    static const EGLenum platforms[] = {EGL_PLATFORM_SURFACELESS_MESA, EGL_PLATFORM_DEVICE_EXT};
    static const char *const extensions[] = {"EGL_MESA_platform_surfaceless",
                                             "EGL_EXT_platform_device"};
    EGLDeviceEXT device = NULL;
    EGLint n_devices = 0;
    if (epoxy_has_egl_extension(EGL_NO_DISPLAY, "EGL_EXT_device_enumeration"))
        eglQueryDevicesEXT(1, &device, &n_devices);
    for (gsize k = 0; k < G_N_ELEMENTS(platforms); k++) {
        if (!epoxy_has_egl_extension(EGL_NO_DISPLAY, extensions[k]))
            continue;
        EGLDisplay display = eglGetPlatformDisplayEXT(platforms[k], k == 1 ? device : NULL, NULL);
        if (display != EGL_NO_DISPLAY && eglInitialize(display, NULL, NULL))
            return display;
    }
    return EGL_NO_DISPLAY;
}

static EGLContext create_context(EGLDisplay display) {
    const EGLint config_wanted[] = {EGL_RENDERABLE_TYPE, EGL_OPENGL_BIT, EGL_SURFACE_TYPE, 0,
                                    EGL_NONE};
    const EGLint wanted[] = {EGL_CONTEXT_MAJOR_VERSION,
                             3,
                             EGL_CONTEXT_MINOR_VERSION,
                             3,
                             EGL_CONTEXT_OPENGL_PROFILE_MASK,
                             EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT,
#ifdef GPU_DEBUG
                             EGL_CONTEXT_OPENGL_DEBUG,
                             EGL_TRUE,
#endif
                             EGL_NONE};
    EGLConfig config = NULL;
    EGLint n_configs = 0;
    if (!eglBindAPI(EGL_OPENGL_API) ||
        !eglChooseConfig(display, config_wanted, &config, 1, &n_configs) || n_configs == 0)
        return EGL_NO_CONTEXT;
    return eglCreateContext(display, config, EGL_NO_CONTEXT, wanted);
}

#ifdef GPU_DEBUG
static void complain(GLenum source, GLenum type, GLuint id, GLenum severity, GLsizei length,
                     const GLchar *text, const void *data) {
    /* Errors of shaders are left out, because gpu_compile() reports them with the names of their
     * files. */
    if (type == GL_DEBUG_TYPE_ERROR && source != GL_DEBUG_SOURCE_SHADER_COMPILER &&
        id != GL_OUT_OF_MEMORY)
        g_critical("OpenGL: %s", text);
}
#endif

void gpu_watch(void) {
#ifdef GPU_DEBUG
    if (epoxy_gl_version() < 43 && !epoxy_has_gl_extension("GL_KHR_debug"))
        return;
    glEnable(GL_DEBUG_OUTPUT);
    glEnable(GL_DEBUG_OUTPUT_SYNCHRONOUS);
    glDebugMessageCallback(complain, NULL);
#endif
}

/* The library stays open, because libepoxy opens it next. */
gboolean gpu_find_library(gboolean window, GError **error) {
    if ((!window && dlopen("libOpenGL.so.0", RTLD_LAZY | RTLD_LOCAL) != NULL) ||
        dlopen("libGL.so.1", RTLD_LAZY | RTLD_LOCAL) != NULL)
        return TRUE;
    g_set_error(error, GPU_ERROR, GPU_ERROR_NONE,
                "the OpenGL library cannot be loaded (%s): install libgl1, and Mesa "
                "(libgl1-mesa-dri), which also draws without a graphics card",
                dlerror());
    return FALSE;
}

Gpu *gpu_new_headless(GError **error) {
    static const char advice[] = "install EGL and Mesa (libegl1, libegl-mesa0, libgl1-mesa-dri), "
                                 "which also draws without a graphics card";
    if (!epoxy_has_egl()) {
        g_set_error(error, GPU_ERROR, GPU_ERROR_NONE, "there is no EGL library here: %s", advice);
        return NULL;
    }
    if (!gpu_find_library(FALSE, error))
        return NULL;
    EGLDisplay display = open_display();
    if (display == EGL_NO_DISPLAY) {
        g_set_error(error, GPU_ERROR, GPU_ERROR_NONE,
                    "EGL offers no way to draw without a window: %s", advice);
        return NULL;
    }
    EGLContext context = create_context(display);
    if (context == EGL_NO_CONTEXT ||
        !eglMakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, context)) {
        g_set_error(
            error, GPU_ERROR, GPU_ERROR_NONE,
            "EGL cannot make an OpenGL 3.3 core context: update the graphics driver, or install "
            "libgl1-mesa-dri and set LIBGL_ALWAYS_SOFTWARE=1 to draw without the graphics card");
        if (context != EGL_NO_CONTEXT)
            eglDestroyContext(display, context);
        return NULL;
    }
    Gpu *gpu = g_new(Gpu, 1);
    *gpu = (Gpu){display, context};
    gpu_watch();
    return gpu;
}

void gpu_free(Gpu *gpu) {
    if (gpu == NULL)
        return;
    eglMakeCurrent(gpu->display, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
    eglDestroyContext(gpu->display, gpu->context);
    eglReleaseThread();
    g_free(gpu);
}

const char *gpu_renderer(void) {
    const char *name = (const char *)glGetString(GL_RENDERER);
    return name != NULL ? name : "unknown";
}

gboolean gpu_has_43(void) {
    return epoxy_gl_version() >= 43;
}

gboolean gpu_check(const char *what, GError **error) {
    GLenum code = glGetError(), next = code;
    for (int k = 0; next != GL_NO_ERROR && k < 16; k++)
        next = glGetError();
    if (code == GL_NO_ERROR)
        return TRUE;
    if (code == GL_OUT_OF_MEMORY)
        g_set_error(error, GPU_ERROR, GPU_ERROR_TOO_LARGE,
                    "%s: the graphics card has no memory left; close other programs, or choose a "
                    "smaller picture, less supersampling or fewer texels",
                    what);
    else
        g_set_error(error, GPU_ERROR, GPU_ERROR_FAILED,
                    "%s: %s reported the OpenGL error 0x%04x; update its driver, or draw without "
                    "it: LIBGL_ALWAYS_SOFTWARE=1",
                    what, gpu_renderer(), code);
    return FALSE;
}

#define MAX_SHADERS 14 /* maximum number of fragment shaders of one program */

static const char *find_shader(const char *name) {
    for (const struct shader *shader = shaders; shader->name != NULL; shader++)
        if (strcmp(shader->name, name) == 0)
            return shader->source;
    g_error("no shader “%s” was compiled in", name);
}

/* Compiles shaders as one text. #line lines are inserted, so that the compiler's log gives the
 * number of the file and the line in this file, such as "3:12". */
static guint gpu_compile(GLenum kind, const char *version, const char *constants,
                         const char *const *names, int n, GError **error) {
    const char *sources[2 + 2 * MAX_SHADERS] = {version, constants};
    char lines[MAX_SHADERS][32];
    g_autoptr(GString) files = g_string_new(NULL);
    for (int k = 0; k < n; k++) {
        g_snprintf(lines[k], sizeof lines[k], "\n#line 1 %d\n", k + 1);
        sources[2 + 2 * k] = lines[k];
        sources[3 + 2 * k] = find_shader(names[k]);
        g_string_append_printf(files, "%s%d is %s", k ? ", " : "file ", k + 1, names[k]);
    }
    GLuint shader = glCreateShader(kind);
    GLint good = 0;
    glShaderSource(shader, 2 + 2 * n, sources, NULL);
    glCompileShader(shader);
    glGetShaderiv(shader, GL_COMPILE_STATUS, &good);
    if (good)
        return shader;
    char log[2000] = "";
    glGetShaderInfoLog(shader, sizeof log, NULL, log);
    glDeleteShader(shader);
    g_set_error(error, GPU_ERROR, GPU_ERROR_PROGRAM,
                "the shader %s does not compile on %s (%s); update its driver, or draw without it "
                "(LIBGL_ALWAYS_SOFTWARE=1): %s",
                names[n - 1], gpu_renderer(), files->str, log);
    return 0;
}

static guint link_program(guint vertex, guint fragment, const char *name, GError **error) {
    GLuint program = glCreateProgram();
    GLint good = 0;
    glAttachShader(program, vertex);
    glAttachShader(program, fragment);
    glLinkProgram(program);
    glGetProgramiv(program, GL_LINK_STATUS, &good);
    if (good)
        return program;
    char log[2000] = "";
    glGetProgramInfoLog(program, sizeof log, NULL, log);
    glDeleteProgram(program);
    g_set_error(error, GPU_ERROR, GPU_ERROR_PROGRAM,
                "the shader %s does not link on %s; update its driver, or draw without it "
                "(LIBGL_ALWAYS_SOFTWARE=1): %s",
                name, gpu_renderer(), log);
    return 0;
}

static guint make_program(const char *version, const char *constants, const char *const *names,
                          GError **error) {
    int n = 0; /* number of fragment shaders, which begin at names[1] */
    while (n < MAX_SHADERS && names[n + 1] != NULL)
        n++;
    guint program = 0, vertex = gpu_compile(GL_VERTEX_SHADER, version, constants, names, 1, error);
    if (vertex == 0)
        return 0;
    guint fragment = gpu_compile(GL_FRAGMENT_SHADER, version, constants, names + 1, n, error);
    if (fragment != 0)
        program = link_program(vertex, fragment, names[n], error);
    glDeleteShader(vertex);
    glDeleteShader(fragment);
    return program;
}

guint gpu_program(const char *constants, const char *const *names, GError **error) {
    return make_program("#version 330 core\n", constants, names, error);
}

guint gpu_program_43(const char *constants, const char *const *names, GError **error) {
    return make_program("#version 430 core\n", constants, names, error);
}

void gpu_fill_screen(void) {
    GLuint empty;
    glGenVertexArrays(1, &empty);
    glBindVertexArray(empty);
    glDrawArrays(GL_TRIANGLES, 0, 3);
    glDeleteVertexArrays(1, &empty);
}

/* Sets *ret_format and *ret_type to the pixel format and type of an internal format. Sets them to
 * GL_RGBA and GL_FLOAT if the internal format is unknown. */
static void texture_format(int internal_format, GLenum *ret_format, GLenum *ret_type) {
    static const struct {
        int internal_format;
        GLenum format, type;
    } formats[] = {
        {GL_RGBA16UI, GL_RGBA_INTEGER, GL_UNSIGNED_SHORT},
        {GL_RG16UI, GL_RG_INTEGER, GL_UNSIGNED_SHORT},
        {GL_R16UI, GL_RED_INTEGER, GL_UNSIGNED_SHORT},
        {GL_R32UI, GL_RED_INTEGER, GL_UNSIGNED_INT},
        {GL_DEPTH24_STENCIL8, GL_DEPTH_STENCIL, GL_UNSIGNED_INT_24_8},
        {GL_DEPTH_COMPONENT32F, GL_DEPTH_COMPONENT, GL_FLOAT},
        {GL_DEPTH_COMPONENT24, GL_DEPTH_COMPONENT, GL_UNSIGNED_INT},
    };
    *ret_format = GL_RGBA;
    *ret_type = GL_FLOAT;
    for (gsize k = 0; k < G_N_ELEMENTS(formats); k++)
        if (formats[k].internal_format == internal_format) {
            *ret_format = formats[k].format;
            *ret_type = formats[k].type;
        }
}

guint gpu_texture(int internal_format, int width, int height, int layers) {
    GLenum target = layers == 0 ? GL_TEXTURE_2D : GL_TEXTURE_2D_ARRAY, format, type;
    GLuint texture;
    texture_format(internal_format, &format, &type);
    glGenTextures(1, &texture);
    glBindTexture(target, texture);
    if (layers == 0)
        glTexImage2D(target, 0, internal_format, width, height, 0, format, type, NULL);
    else
        glTexImage3D(target, 0, internal_format, width, height, layers, 0, format, type, NULL);
    glTexParameteri(target, GL_TEXTURE_MAX_LEVEL, 0);
    glTexParameteri(target, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
    glTexParameteri(target, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
    glTexParameteri(target, GL_TEXTURE_WRAP_S, GL_CLAMP_TO_EDGE);
    glTexParameteri(target, GL_TEXTURE_WRAP_T, GL_CLAMP_TO_EDGE);
    return texture;
}

guint gpu_texture_levels(int internal_format, int width, int height, int layers, int n_levels) {
    const guint texture = gpu_texture(internal_format, width, height, layers);
    GLenum format, type;
    texture_format(internal_format, &format, &type);
    for (int k = 1; k < n_levels; k++)
        glTexImage3D(GL_TEXTURE_2D_ARRAY, k, internal_format, MAX(1, width >> k),
                     MAX(1, height >> k), layers, 0, format, type, NULL);
    glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MAX_LEVEL, n_levels - 1);
    glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MIN_FILTER, GL_NEAREST_MIPMAP_NEAREST);
    return texture;
}

void gpu_bind_texture(guint program, const char *name, int unit, guint target, guint texture) {
    glActiveTexture(GL_TEXTURE0 + unit);
    glBindTexture(target, texture);
    glActiveTexture(GL_TEXTURE0);
    glUniform1i(glGetUniformLocation(program, name), unit);
}

static GLint of_level(guint target, int level, GLenum what) {
    GLint value = 0;
    glGetTexLevelParameteriv(target, level, what, &value);
    return value;
}

void gpu_texture_size(guint target, guint texture, int level, int ret[2]) {
    glBindTexture(target, texture);
    glGetTexLevelParameteriv(target, level, GL_TEXTURE_WIDTH, &ret[0]);
    glGetTexLevelParameteriv(target, level, GL_TEXTURE_HEIGHT, &ret[1]);
}

gint64 gpu_texture_bytes(guint target, guint texture) {
    static const GLenum sizes[] = {GL_TEXTURE_RED_SIZE,   GL_TEXTURE_GREEN_SIZE,
                                   GL_TEXTURE_BLUE_SIZE,  GL_TEXTURE_ALPHA_SIZE,
                                   GL_TEXTURE_DEPTH_SIZE, GL_TEXTURE_SHARED_SIZE};
    const gboolean cube = target == GL_TEXTURE_CUBE_MAP;
    gint64 bytes = 0;
    if (texture == 0)
        return 0;
    glBindTexture(target, texture);
    if (cube)
        target = GL_TEXTURE_CUBE_MAP_POSITIVE_X;
    const int largest =
        MAX(of_level(target, 0, GL_TEXTURE_WIDTH), of_level(target, 0, GL_TEXTURE_HEIGHT));
    const int last = target == GL_TEXTURE_BUFFER ? 0 : g_bit_nth_msf((gulong)largest, -1);
    for (int level = 0; level <= last; level++) {
        if (of_level(target, level, GL_TEXTURE_COMPRESSED)) {
            bytes += of_level(target, level, GL_TEXTURE_COMPRESSED_IMAGE_SIZE);
            continue;
        }
        gint64 bits = 0;
        for (gsize k = 0; k < G_N_ELEMENTS(sizes); k++)
            bits += of_level(target, level, sizes[k]);
        bytes += bits / 8 * of_level(target, level, GL_TEXTURE_WIDTH) *
                 of_level(target, level, GL_TEXTURE_HEIGHT) *
                 of_level(target, level, GL_TEXTURE_DEPTH);
    }
    return cube ? 6 * bytes : bytes;
}

gboolean gpu_target_resize(struct gpu_target *target, int width, int height, int internal_format,
                           gboolean depth, GError **error) {
    if (target->framebuffer != 0 && target->width == width && target->height == height)
        return TRUE;
    gpu_target_clear(target);
    GLint largest = 0;
    glGetIntegerv(GL_MAX_TEXTURE_SIZE, &largest);
    if (width < 1 || height < 1 || width > largest || height > largest) {
        g_set_error(error, GPU_ERROR, GPU_ERROR_TOO_LARGE,
                    "a picture of %d × %d samples is not possible: %s draws 1 to %d in each "
                    "direction; choose another size or less supersampling",
                    width, height, gpu_renderer(), largest);
        return FALSE;
    }
    target->width = width;
    target->height = height;
    target->colour = gpu_texture(internal_format, width, height, 0);
    glGenFramebuffers(1, &target->framebuffer);
    glBindFramebuffer(GL_FRAMEBUFFER, target->framebuffer);
    glFramebufferTexture2D(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_TEXTURE_2D, target->colour, 0);
    if (depth) {
        target->depth = gpu_texture(GL_DEPTH_COMPONENT24, width, height, 0);
        glFramebufferTexture2D(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_TEXTURE_2D, target->depth,
                               0);
    }
    if (gpu_check("making a picture to draw into", error)) {
        if (glCheckFramebufferStatus(GL_FRAMEBUFFER) == GL_FRAMEBUFFER_COMPLETE)
            return TRUE;
        g_set_error(
            error, GPU_ERROR, GPU_ERROR_FAILED,
            "%s cannot draw into a picture of the OpenGL format 0x%04x; update its driver, or draw "
            "without it: LIBGL_ALWAYS_SOFTWARE=1",
            gpu_renderer(), internal_format);
    }
    gpu_target_clear(target);
    return FALSE;
}

void gpu_target_clear(struct gpu_target *target) {
    glDeleteFramebuffers(1, &target->framebuffer);
    glDeleteTextures(1, &target->colour);
    glDeleteTextures(1, &target->depth);
    *target = (struct gpu_target){0};
}

void gpu_flip_rows(void *picture, gsize stride, int height) {
    g_autofree guint8 *row = g_malloc(stride);
    for (int j = 0; j < height / 2; j++) {
        guint8 *a = (guint8 *)picture + j * stride;
        guint8 *b = (guint8 *)picture + (height - 1 - j) * stride;
        memcpy(row, a, stride);
        memcpy(a, b, stride);
        memcpy(b, row, stride);
    }
}

guint8 *gpu_target_read(const struct gpu_target *target, GError **error) {
    g_autofree guint8 *rgb = g_malloc(3 * (gsize)target->width * target->height);
    glBindFramebuffer(GL_FRAMEBUFFER, target->framebuffer);
    glPixelStorei(GL_PACK_ALIGNMENT, 1);
    glReadPixels(0, 0, target->width, target->height, GL_RGB, GL_UNSIGNED_BYTE, rgb);
    if (!gpu_check("reading the picture", error))
        return NULL;
    gpu_flip_rows(rgb, 3 * (gsize)target->width, target->height);
    return g_steal_pointer(&rgb);
}
