/* Reads the positions of cameras and lamps. Imported files may have directions only, as if cameras
 * and lamps were far away. */
#include "near_field.h"

#include <math.h>
#include <string.h>

#include "base/data_error.h"
#include "btf.h"
#include "btf_matrix_private.h"

#define DEGREE       (G_PI / 180)
#define MAX_EXPONENT 1000

void near_field_free(struct near_field *near_field) {
    if (!near_field)
        return;
    direction_list_clear(&near_field->views);
    direction_list_clear(&near_field->lights);
    g_free(near_field->camera_mm);
    g_free(near_field->lamp_mm);
    g_free(near_field->lamp_aim);
    g_free(near_field->lamp_exponent);
    g_free(near_field);
}

static gboolean has(const struct exr_part *part, const char *name) {
    double ignored[3];
    return exr_get_v3d(part, name, ignored, NULL);
}

static gboolean take_position(const struct near_field *near_field, const struct exr_part *part,
                              const char *name, const char *path, struct vec3 *ret,
                              GError **error) {
    double at[3];
    if (!exr_get_v3d(part, name, at, NULL))
        return data_error_fail(path, 0, error,
                               "part %s lacks the position %s, which other parts of the BTF "
                               "have" BTF_AGAIN,
                               part->name, name);
    if (!isfinite(at[0]) || !isfinite(at[1]) || !(at[2] > near_field->grid.reference_mm) ||
        !isfinite(at[2]))
        return data_error_fail(
            path, 0, error,
            "in part %s the position %s is (%g, %g, %g) mm, but must be finite and "
            "above the reference plane at z = %g mm" BTF_AGAIN,
            part->name, name, at[0], at[1], at[2], near_field->grid.reference_mm);
    *ret = vec3(at[0], at[1], at[2]);
    return TRUE;
}

/* Takes the aim and the exponent of a lamp, if the part has them. */
static gboolean take_aim(const struct exr_part *part, const char *path, struct vec3 *ret_aim,
                         double *ret_exponent, GError **error) {
    double aim[3];
    *ret_aim = vec3(0, 0, -1);
    if (exr_get_v3d(part, "light.aim", aim, NULL)) {
        const double length = vec3_length(vec3(aim[0], aim[1], aim[2]));
        if (!(length > 0) || !isfinite(length))
            return data_error_fail(path, 0, error,
                                   "in part %s light.aim is (%g, %g, %g), which is not a "
                                   "direction" BTF_AGAIN,
                                   part->name, aim[0], aim[1], aim[2]);
        *ret_aim = vec3_scale(vec3(aim[0], aim[1], aim[2]), 1 / length);
    }
    if (!exr_get_double(part, "light.exponent", ret_exponent, NULL))
        *ret_exponent = 0;
    return (*ret_exponent >= 0 && *ret_exponent <= MAX_EXPONENT) ||
           data_error_fail(path, 0, error,
                           "in part %s light.exponent is %g, but must be 0 to %d" BTF_AGAIN,
                           part->name, *ret_exponent, MAX_EXPONENT);
}

/* Takes the directions and positions of a view and of its lamps from the headers of its file. The
 * camera's position is the mean over the parts. */
static gboolean take_view(struct near_field *to, const struct exr_file *file, int view,
                          const char *path, GError **error) {
    if (file->parts->len != to->lights.n)
        return data_error_fail(
            path, 0, error,
            "the file has %u lights, but the file of the first view has %zu" BTF_AGAIN,
            file->parts->len, to->lights.n);
    struct vec3 first = {0}, off = {0};
    for (gsize light = 0; light < to->lights.n; light++) {
        const struct exr_part *part = g_ptr_array_index(file->parts, (guint)light);
        const gsize at = (gsize)view * to->lights.n + light;
        float theta, phi;
        if (!btf_direction(part, "view", &to->views.theta_deg[view], &to->views.phi_deg[view]) ||
            !btf_direction(part, "light", &theta, &phi))
            return data_error_fail(path, 0, error,
                                   "in part %s an angle theta_deg or phi_deg of view or light is "
                                   "missing or not a finite number" BTF_AGAIN,
                                   part->name);
        if (theta != to->lights.theta_deg[light] || phi != to->lights.phi_deg[light])
            return data_error_fail(path, 0, error,
                                   "the light of part %s is at θ %g°, φ %g°, but at θ %g°, φ %g° "
                                   "in the first view" BTF_AGAIN,
                                   part->name, (double)theta, (double)phi,
                                   (double)to->lights.theta_deg[light],
                                   (double)to->lights.phi_deg[light]);
        if ((!to->camera_mm && has(part, "view.centre_mm")) ||
            (!to->lamp_mm && has(part, "light.position_mm")))
            return data_error_fail(path, 0, error,
                                   "part %s has the position of camera or lamp, which the first "
                                   "part of the BTF lacks" BTF_AGAIN,
                                   part->name);
        struct vec3 camera;
        if (to->lamp_mm &&
            (!take_position(to, part, "light.position_mm", path, &to->lamp_mm[at], error) ||
             !take_aim(part, path, &to->lamp_aim[at], &to->lamp_exponent[at], error)))
            return FALSE;
        if (!to->camera_mm)
            continue;
        if (!take_position(to, part, "view.centre_mm", path, &camera, error))
            return FALSE;
        if (light == 0)
            first = camera;
        off = vec3_add(off, vec3_sub(camera, first));
    }
    if (to->camera_mm)
        to->camera_mm[view] = vec3_add(first, vec3_scale(off, 1.0 / (double)to->lights.n));
    return TRUE;
}

/* Reads the headers of all views. The first view gives the directions of the lights and decides
 * whether the files have positions. */
static gboolean do_read_views(struct near_field *to, struct btf_matrix *btf, const GPtrArray *paths,
                              GError **error) {
    gboolean ok = TRUE;
    for (gsize view = 0; ok && view < to->views.n; view++) {
        const char *path = g_ptr_array_index(paths, (guint)view);
        struct exr_file *file = exr_read_headers(path, error);
        ok = file && (view > 0 || btf_take_lights(btf, file, path, error));
        if (ok && view == 0) {
            to->lights = direction_list_copy(&btf->layout.lights);
            const gsize n = to->views.n * to->lights.n;
            if (has(g_ptr_array_index(file->parts, 0), "view.centre_mm"))
                to->camera_mm = g_new0(struct vec3, to->views.n);
            if (has(g_ptr_array_index(file->parts, 0), "light.position_mm")) {
                to->lamp_mm = g_new0(struct vec3, n);
                to->lamp_aim = g_new0(struct vec3, n);
                to->lamp_exponent = g_new0(double, n);
            }
        }
        ok = ok && take_view(to, file, view, path, error);
        exr_file_free(file);
    }
    return ok;
}

struct near_field *near_field_read(const char *path, GError **error) {
    g_autoptr(GPtrArray) paths = NULL;
    struct btf_matrix *btf = btf_open(path, TRUE, NULL, &paths, error);
    if (!btf)
        return NULL;
    g_autoptr(Session) session = session_open(btf->directory, SESSION_READ, error);
    struct near_field *ret = g_new0(struct near_field, 1);
    ret->views = direction_list_new(btf->layout.views.n);
    if (!session || !session_grid(session, &ret->grid, error) ||
        !do_read_views(ret, btf, paths, error))
        g_clear_pointer(&ret, near_field_free);
    btf_matrix_free(btf);
    return ret;
}

struct vec3 near_field_texel_mm(const struct near_field *near_field, int texel) {
    const struct session_grid *grid = &near_field->grid;
    return rectify_point_mm(grid, texel % grid->width + 0.5, (int)(texel / grid->width) + 0.5);
}

/* Returns the unit vector (camera − from) / |camera − from|, or the nominal direction if there
 * are no positions. */
static struct vec3 view_from(const struct near_field *n, int view, struct vec3 from) {
    return n->camera_mm ? vec3_unit(vec3_sub(n->camera_mm[view], from))
                        : rig_direction((double)n->views.theta_deg[view] * DEGREE,
                                        (double)n->views.phi_deg[view] * DEGREE);
}

static struct vec3 light_from(const struct near_field *n, int view, int light, struct vec3 from) {
    const gsize at = (gsize)view * n->lights.n + (gsize)light;
    return n->lamp_mm ? vec3_unit(vec3_sub(n->lamp_mm[at], from))
                      : rig_direction((double)n->lights.theta_deg[light] * DEGREE,
                                      (double)n->lights.phi_deg[light] * DEGREE);
}

struct vec3 near_field_view(const struct near_field *near_field, int view, int texel) {
    return view_from(near_field, view, near_field_texel_mm(near_field, texel));
}

struct vec3 near_field_light(const struct near_field *near_field, int view, int light, int texel) {
    return light_from(near_field, view, light, near_field_texel_mm(near_field, texel));
}

static struct vec3 middle(const struct near_field *near_field) {
    return vec3(0, 0, near_field->grid.reference_mm);
}

struct vec3 near_field_view_centre(const struct near_field *near_field, int view) {
    return view_from(near_field, view, middle(near_field));
}

struct vec3 near_field_light_centre(const struct near_field *near_field, int view, int light) {
    return light_from(near_field, view, light, middle(near_field));
}

/* Returns the irradiance at a point on a plane that faces the lamp, without the intensity of the
 * lamp. */
static double irradiance(const struct near_field *n, gsize lamp, struct vec3 point_mm) {
    const struct vec3 way = vec3_sub(point_mm, n->lamp_mm[lamp]);
    const double r = vec3_length(way);
    const double cosine = fmax(vec3_dot(way, n->lamp_aim[lamp]) / r, 0);
    return pow(cosine, n->lamp_exponent[lamp]) / (r * r);
}

double near_field_fall_off(const struct near_field *near_field, int view, int light, int texel) {
    if (!near_field->lamp_mm)
        return 1;
    const gsize lamp = (gsize)view * near_field->lights.n + (gsize)light;
    const double centre = irradiance(near_field, lamp, middle(near_field));
    return centre > 0
               ? irradiance(near_field, lamp, near_field_texel_mm(near_field, texel)) / centre
               : 0;
}
