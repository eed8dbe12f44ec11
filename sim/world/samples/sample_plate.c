#include "sample.h"

#include "base/input_file.h"

#include <math.h>

#define MAX_CELLS (1u << 20)
#define RAD(deg)  ((deg) * (G_PI / 180))

/* The sample is a flat plate on which a picture is printed. Each pixel of the picture is a
 * rectangle, so the edges of the print are sharp from any distance. The plate may be rotated,
 * tilted and off the centre, like a plate that was put down by hand. */

struct plate {
    const struct sample_options *options;
    double across[3], along[3], up[3]; /* axes of the plate in the sample frame */
    double middle[3];                  /* middle of the plate's printed side */
};

static void turn(double v[3], int a, int b, double angle) {
    const double c = cos(angle), s = sin(angle), x = v[a], y = v[b];
    v[a] = c * x - s * y;
    v[b] = s * x + c * y;
}

/* Turns an axis of the plate about the normal of the plate. Then tilts the axis together with the
 * plate. The normal then leans towards the azimuth tilt_towards_deg. */
static void place_axis(const struct sample_options *o, double v[3]) {
    turn(v, 0, 1, RAD(o->turn_deg - o->tilt_towards_deg));
    turn(v, 2, 0, RAD(o->tilt_deg));
    turn(v, 0, 1, RAD(o->tilt_towards_deg));
}

static guint32 add_corner(struct mesh *mesh, const struct plate *plate, double u, double v,
                          double depth, const float *albedo) {
    struct vertex vertex = {.along = 1, .across = 1};
    for (int k = 0; k < 3; k++) {
        vertex.p[k] =
            (float)(plate->middle[k] + plate->across[k] * (u - 0.5) * plate->options->width_mm +
                    plate->along[k] * (0.5 - v) * plate->options->height_mm - plate->up[k] * depth);
        vertex.n[k] = (float)plate->up[k];
        vertex.t[k] = (float)plate->across[k];
        vertex.albedo[k] = albedo[k];
    }
    return sample_add_vertex(mesh, &vertex);
}

static void add_cells(struct mesh *mesh, const struct plate *plate, const png_image *image,
                      const guint16 *values) {
    for (guint32 j = 0; j < image->height; j++)
        for (guint32 i = 0; i < image->width; i++) {
            const guint16 *pixel = values + 3 * ((gsize)j * image->width + i);
            const float albedo[3] = {(float)pixel[0] / 65535, (float)pixel[1] / 65535,
                                     (float)pixel[2] / 65535};
            const double u0 = (double)i / image->width, u1 = (double)(i + 1) / image->width;
            const double v0 = (double)j / image->height, v1 = (double)(j + 1) / image->height;
            const guint32 a = add_corner(mesh, plate, u0, v1, 0, albedo);
            const guint32 b = add_corner(mesh, plate, u1, v1, 0, albedo);
            const guint32 c = add_corner(mesh, plate, u1, v0, 0, albedo);
            const guint32 d = add_corner(mesh, plate, u0, v0, 0, albedo);
            sample_add_quad(mesh, a, b, c, d);
        }
}

/* Adds the four sides, which are dark. The plate has no lower face, because no camera sees the
 * plate from below. */
static void add_sides(struct mesh *mesh, const struct plate *plate) {
    static const double corners[4][2] = {{0, 1}, {1, 1}, {1, 0}, {0, 0}};
    static const float dark[3] = {0.05f, 0.05f, 0.05f};
    for (int k = 0; k < 4; k++) {
        const double *p = corners[k], *q = corners[(k + 1) % 4];
        const double depth = plate->options->base_mm;
        const guint first_triangle = mesh->triangles->len;
        const guint32 a = add_corner(mesh, plate, p[0], p[1], depth, dark);
        const guint32 b = add_corner(mesh, plate, q[0], q[1], depth, dark);
        const guint32 c = add_corner(mesh, plate, q[0], q[1], 0, dark);
        const guint32 d = add_corner(mesh, plate, p[0], p[1], 0, dark);
        sample_add_quad(mesh, a, b, c, d);
        sample_smooth_normals(mesh, a, first_triangle);
    }
}

static gboolean read_print(png_image *image, const char *path, guint16 **ret, GError **error) {
    gsize length;
    g_autofree char *bytes = input_file_read(path, G_MAXINT, &length, error);
    if (!bytes)
        return FALSE;
    if (!png_image_begin_read_from_memory(image, bytes, length))
        return sample_picture_error(image, path, error);
    if ((guint64)image->width * image->height > MAX_CELLS) {
        g_set_error(error, CONFIG_ERROR, CONFIG_ERROR_VALUE,
                    "%s has %u × %u pixels, but the print of a plate may have at most %u pixels; "
                    "make the picture smaller",
                    path, image->width, image->height, MAX_CELLS);
        png_image_free(image);
        return FALSE;
    }
    image->format = PNG_FORMAT_LINEAR_RGB;
    *ret = g_malloc(PNG_IMAGE_SIZE(*image));
    png_color black = {0, 0, 0};
    if (png_image_finish_read(image, &black, *ret, 0, NULL))
        return TRUE;
    g_clear_pointer(ret, g_free);
    return sample_picture_error(image, path, error);
}

struct mesh *sample_plate(const struct sample_options *options, GError **error) {
    png_image image = {.version = PNG_IMAGE_VERSION};
    struct plate plate = {options, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0}};
    g_autofree guint16 *values = NULL;
    if (!read_print(&image, options->albedo_path, &values, error) || !values)
        return NULL;
    struct mesh *mesh = sample_mesh_new();
    place_axis(options, plate.across);
    place_axis(options, plate.along);
    place_axis(options, plate.up);
    /* The plate is placed so that its lowest corner touches the turntable. */
    const double reach = fabs(plate.across[2]) * options->width_mm / 2 +
                         fabs(plate.along[2]) * options->height_mm / 2;
    for (int k = 0; k < 2 && options->offset_mm.n == 2; k++)
        plate.middle[k] = options->offset_mm.values[k];
    plate.middle[2] = reach + options->base_mm * plate.up[2];
    add_cells(mesh, &plate, &image, values);
    add_sides(mesh, &plate);
    return mesh;
}
