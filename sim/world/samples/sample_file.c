#include "sample.h"

#include "base/input_file.h"

#include <math.h>
#include <string.h>

#define MAX_OBJ_BYTES (256u << 20)

struct picture {
    guint32 width, height;
    int channels;
    float *values; /* 0 … 1, top row first */
};

gboolean sample_picture_error(png_image *image, const char *path, GError **error) {
    g_set_error(
        error, CONFIG_ERROR, CONFIG_ERROR_VALUE,
        "%s is not a PNG picture, or is damaged (libpng says: %s); save the picture as PNG again",
        path, image->message);
    png_image_free(image);
    return FALSE;
}

/* Reads a PNG picture. Colours of 8 bits are converted from sRGB to linear values. All values of 16
 * bits are taken as linear. Heights of 8 bits are also taken as linear, because heights have no
 * gamma. */
static gboolean read_picture(const char *path, gboolean heights, struct picture *ret,
                             GError **error) {
    png_image image = {.version = PNG_IMAGE_VERSION};
    gsize length;
    g_autofree char *bytes = input_file_read(path, G_MAXINT, &length, error);
    if (!bytes)
        return FALSE;
    if (!png_image_begin_read_from_memory(&image, bytes, length))
        return sample_picture_error(&image, path, error);
    if (!input_file_check_pixels(path, image.width, image.height, length, error)) {
        png_image_free(&image);
        return FALSE;
    }
    gboolean wide = !heights || (image.format & PNG_FORMAT_FLAG_LINEAR);
    image.format = heights ? (wide ? PNG_FORMAT_LINEAR_Y : PNG_FORMAT_GRAY) : PNG_FORMAT_LINEAR_RGB;
    g_autofree guint8 *raw = g_malloc(PNG_IMAGE_SIZE(image));
    png_color black = {0, 0, 0};
    if (!png_image_finish_read(&image, &black, raw, 0, NULL))
        return sample_picture_error(&image, path, error);
    *ret = (struct picture){image.width, image.height, heights ? 1 : 3, NULL};
    gsize n = (gsize)image.width * image.height * (gsize)ret->channels;
    ret->values = g_new(float, n);
    for (gsize i = 0; i < n; i++)
        ret->values[i] =
            wide ? (float)((const guint16 *)(gpointer)raw)[i] / 65535 : (float)raw[i] / 255;
    return TRUE;
}

static float pixel(const struct picture *picture, gint64 x, gint64 y, int channel) {
    gsize column = (gsize)CLAMP(x, 0, (gint64)picture->width - 1);
    gsize row = (gsize)CLAMP(y, 0, (gint64)picture->height - 1);
    return picture
        ->values[(row * picture->width + column) * (gsize)picture->channels + (gsize)channel];
}

/* Returns the value of a channel at (u, v), interpolated bilinearly. u is from 0 at the left to 1
 * at the right. v is from 0 at the bottom to 1 at the top. */
static double look_up(const struct picture *picture, double u, double v, int channel) {
    double x = u * picture->width - 0.5, y = (1 - v) * picture->height - 0.5;
    double fx = floor(x), fy = floor(y);
    gint64 i = (gint64)fx, j = (gint64)fy;
    double top = pixel(picture, i, j, channel) * (1 - (x - fx)) +
                 pixel(picture, i + 1, j, channel) * (x - fx);
    double bottom = pixel(picture, i, j + 1, channel) * (1 - (x - fx)) +
                    pixel(picture, i + 1, j + 1, channel) * (x - fx);
    return top * (1 - (y - fy)) + bottom * (y - fy);
}

struct pictured {
    const struct sample_options *options;
    struct picture relief, albedo;
};

static void pictured_relief(struct vertex *vertex, gconstpointer data) {
    const struct pictured *from = data;
    const struct sample_options *o = from->options;
    double u = vertex->p[0] / o->width_mm + 0.5, v = vertex->p[1] / o->height_mm + 0.5;
    vertex->p[2] = (float)(o->base_mm + o->relief_mm * look_up(&from->relief, u, v, 0));
    sample_set_rgb(vertex->albedo, &o->albedo, 0.5f, 0.5f, 0.5f);
    for (int k = 0; k < 3 && from->albedo.values; k++)
        vertex->albedo[k] = (float)look_up(&from->albedo, u, v, k);
    sample_set_gloss(vertex, o, 0, 0.3, 0.3);
}

struct mesh *sample_picture(const struct sample_options *options, GError **error) {
    struct pictured from = {.options = options};
    gboolean coloured = options->albedo_path && *options->albedo_path;
    struct mesh *mesh = NULL;
    if (read_picture(options->path, TRUE, &from.relief, error) &&
        (!coloured || read_picture(options->albedo_path, FALSE, &from.albedo, error))) {
        mesh = sample_mesh_new();
        sample_add_relief(mesh, options, options->grid, options->grid, pictured_relief, &from);
    }
    g_free(from.relief.values);
    g_free(from.albedo.values);
    return mesh;
}

struct obj {
    const struct sample_options *options;
    const char *path;
    int line;
    GArray *positions; /* float[3] */
    struct mesh *mesh;
};

static gboolean G_GNUC_PRINTF(3, 4)
    obj_error(const struct obj *obj, GError **error, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    g_autofree char *what = g_strdup_vprintf(format, arguments);
    va_end(arguments);
    g_set_error(error, CONFIG_ERROR, CONFIG_ERROR_VALUE, "%s:%d: %s", obj->path, obj->line, what);
    return FALSE;
}

static gboolean obj_position(struct obj *obj, const char *text, GError **error) {
    float p[3];
    for (int k = 0; k < 3; k++) {
        char *end = NULL;
        double value = g_ascii_strtod(text, &end);
        if (end == text || !isfinite(value))
            return obj_error(obj, error,
                             "coordinate %d of the vertex is missing or is not a number; write "
                             "three numbers in mm, such as v 1.5 0 2",
                             k + 1);
        if (fabs(value) > 1e4)
            return obj_error(obj, error,
                             "coordinate %d of the vertex is %g mm, but may be at most 10000 mm "
                             "from 0; save the mesh in millimetres",
                             k + 1, value);
        p[k] = (float)value;
        text = end;
    }
    g_array_append_vals(obj->positions, p, 1);
    return TRUE;
}

static guint32 obj_vertex(struct obj *obj, guint32 position) {
    struct vertex vertex = {.n = {0, 0, 1}, .t = {1, 0, 0}};
    memcpy(vertex.p, obj->positions->data + position * sizeof(float[3]), sizeof vertex.p);
    sample_set_rgb(vertex.albedo, &obj->options->albedo, 0.5f, 0.5f, 0.5f);
    sample_set_gloss(&vertex, obj->options, 0, 0.3, 0.3);
    return sample_add_vertex(obj->mesh, &vertex);
}

/* Reads a corner of a face, such as "7", "7/1" or "7//3". A negative number counts back from the
 * last vertex. Moves *text past the corner and the blanks after it. Returns FALSE with an error if
 * there is no corner, or if the file does not define the vertex before the face. */
static gboolean obj_corner(struct obj *obj, const char **text, guint32 *ret, GError **error) {
    char *end = NULL;
    gint64 index = g_ascii_strtoll(*text, &end, 10);
    guint n = obj->positions->len;
    if (!**text)
        return obj_error(obj, error, "a face has fewer than three corners; give it at least three");
    if (end == *text)
        return obj_error(obj, error,
                         "the corner “%s” of a face does not begin with the number of a vertex; "
                         "export the mesh again",
                         *text);
    if (index == 0 || index > (gint64)n || index < -(gint64)n)
        return obj_error(obj, error,
                         "a face has the vertex %" G_GINT64_FORMAT
                         " as a corner, but %u vertices come before the face; write the lines "
                         "of the vertices first",
                         index, n);
    *ret = (guint32)(index > 0 ? index - 1 : (gint64)n + index);
    *text = end + strcspn(end, " \t");
    *text += strspn(*text, " \t");
    return TRUE;
}

static gboolean obj_face(struct obj *obj, const char *text, GError **error) {
    guint32 first = 0, before = 0, corner = 0;
    if (!obj_corner(obj, &text, &first, error) || !obj_corner(obj, &text, &before, error))
        return FALSE;
    if (!*text)
        return obj_error(obj, error, "a face has only two corners; give it at least three");
    while (*text) {
        if (!obj_corner(obj, &text, &corner, error))
            return FALSE;
        if (obj->options->smooth)
            sample_add_triangle(obj->mesh, first, before, corner);
        else {
            guint32 a = obj_vertex(obj, first);
            obj_vertex(obj, before);
            obj_vertex(obj, corner);
            sample_add_triangle(obj->mesh, a, a + 1, a + 2);
        }
        before = corner;
    }
    return TRUE;
}

static gboolean obj_lines(struct obj *obj, char *text, GError **error) {
    for (char *line = text, *next; line; line = next) {
        next = strchr(line, '\n');
        if (next)
            *next++ = 0;
        obj->line++;
        g_strstrip(line);
        if (g_str_has_prefix(line, "v ") && !obj_position(obj, line + 2, error))
            return FALSE;
        if (g_str_has_prefix(line, "f ") &&
            !obj_face(obj, line + 2 + strspn(line + 2, " \t"), error))
            return FALSE;
    }
    return TRUE;
}

struct mesh *sample_obj(const struct sample_options *options, GError **error) {
    g_autofree char *text = input_file_read_text(options->path, MAX_OBJ_BYTES, error);
    if (!text)
        return NULL;
    g_autoptr(GArray) positions = g_array_new(FALSE, FALSE, sizeof(float[3]));
    struct obj obj = {options, options->path, 0, positions, sample_mesh_new()};
    if (!obj_lines(&obj, text, error)) {
        sample_free(obj.mesh);
        return NULL;
    }
    /* The faces of a smooth mesh share vertices, one for each position and in the same order. A
     * face needs only the numbers of its vertices, so the vertices are added at the end. */
    for (guint32 i = 0; options->smooth && i < positions->len; i++)
        obj_vertex(&obj, i);
    sample_smooth_normals(obj.mesh, 0, 0);
    return obj.mesh;
}
