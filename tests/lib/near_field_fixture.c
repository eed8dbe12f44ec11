#include "near_field_fixture.h"
#include "lib/ok.h"

char *near_folder;

void near_field_add_ring(struct rings *rings, double theta, int n, double offset) {
    for (int k = 0; k < n; k++) {
        rings->theta[rings->n] = (float)theta;
        rings->phi[rings->n++] = (float)(offset + 360.0 * k / n);
    }
}

struct rings near_field_twelve(double offset) {
    struct rings rings = {0};
    for (int ring = 1; ring <= 5; ring++)
        near_field_add_ring(&rings, 15 * ring, 12, offset);
    return rings;
}

void near_field_direction(double theta_deg, double phi_deg, double ret[3]) {
    ret[0] = sin(theta_deg * DEGREE) * cos(phi_deg * DEGREE);
    ret[1] = sin(theta_deg * DEGREE) * sin(phi_deg * DEGREE);
    ret[2] = cos(theta_deg * DEGREE);
}

void near_field_texel_centre(int texel, double ret[3]) {
    ret[0] = SIDE_MM * ((texel % SIDE + 0.5) / SIDE - 0.5);
    ret[1] = SIDE_MM * (0.5 - (texel / SIDE + 0.5) / SIDE); // NOLINT(bugprone-integer-division)
    ret[2] = LEVEL_MM;
}

void near_field_towards(const double at[3], const double from[3], double ret[3]) {
    double length = 0;
    for (int k = 0; k < 3; k++) {
        ret[k] = at[k] - from[k];
        length += ret[k] * ret[k];
    }
    for (int k = 0; k < 3; k++)
        ret[k] /= sqrt(length);
}

void near_field_camera_at(const struct rings *views, int view, double ret[3]) {
    near_field_direction((double)views->theta[view], (double)views->phi[view], ret);
    for (int k = 0; k < 3; k++)
        ret[k] *= CAMERA_MM;
    ret[2] += LEVEL_MM;
}

void near_field_lamp_at(const struct rings *lights, int view, int light, double ret[3]) {
    near_field_direction((double)lights->theta[light], (double)lights->phi[light], ret);
    for (int k = 0; k < 3; k++)
        ret[k] *= LAMP_MM + 20 * (light % 3);
    ret[0] += cos(view);
    ret[2] += LEVEL_MM + sin(view);
}

double near_field_formula(const double view[3], const double light[3], double width, int colour) {
    static const double albedo[] = {0.6, 0.3, 0.1};
    double half[3], length = 0;
    for (int k = 0; k < 3; k++) {
        half[k] = view[k] + light[k];
        length += half[k] * half[k];
    }
    const double cosine = half[2] / sqrt(length), tan2 = 1 / (cosine * cosine) - 1;
    return light[2] * (albedo[colour] + (width > 0 ? 0.8 * exp(-tan2 / (width * width)) : 0));
}

static struct exr_part *near_field_make_part(const struct rings *views, const struct rings *lights,
                                             int view, int light, const struct wish *wish) {
    static const char *const channels[] = {"B", "G", "R", "mark", NULL};
    g_autofree char *name = g_strdup_printf("light_%04d", light);
    struct exr_part *part = exr_part_new(name, SIDE, SIDE, channels, EXR_HALF);
    double camera[3], lamp[3];
    near_field_camera_at(views, view, camera);
    near_field_lamp_at(lights, view, light, lamp);
    exr_set_double(part, "view.theta_deg", (double)views->theta[view]);
    exr_set_double(part, "view.phi_deg", (double)views->phi[view]);
    exr_set_double(part, "light.theta_deg", (double)lights->theta[light]);
    exr_set_double(part, "light.phi_deg", (double)lights->phi[light]);
    if (!wish->nowhere) {
        exr_set_v3d(part, "view.centre_mm", camera[0], camera[1], camera[2]);
        exr_set_v3d(part, "light.position_mm", lamp[0], lamp[1], lamp[2]);
    }
    for (int texel = 0; texel < ALL; texel++) {
        double at[3], v[3], l[3];
        near_field_texel_centre(texel, at);
        near_field_towards(camera, at, v);
        near_field_towards(lamp, at, l);
        if (wish->nowhere) {
            near_field_direction((double)views->theta[view], (double)views->phi[view], v);
            near_field_direction((double)lights->theta[light], (double)lights->phi[light], l);
        }
        for (int c = 0; c < 3; c++)
            part->planes[2 - c][texel] = (float)near_field_formula(v, l, wish->width, c);
    }
    if (wish->spoil)
        wish->spoil(part, view, light);
    return part;
}

static struct session_direction *near_field_plan_of(const struct rings *rings) {
    struct session_direction *list = g_new0(struct session_direction, rings->n);
    for (int i = 0; i < rings->n; i++)
        list[i] = (struct session_direction){
            .index = i, .theta_deg = (double)rings->theta[i], .phi_deg = (double)rings->phi[i]};
    return list;
}

char *near_field_make_session(const char *name, const struct rings *views,
                              const struct rings *lights, const struct wish *wish) {
    char *path = g_strdup_printf("%s/%s.session", near_folder, name);
    g_autofree struct session_direction *view_plan = near_field_plan_of(views),
                                        *light_plan = near_field_plan_of(lights);
    const struct session_texts texts = {"", "", "", NULL};
    const struct session_plan plan = {.grid = {SIDE, SIDE, SIDE_MM, SIDE_MM, LEVEL_MM, LEVEL_MM},
                                      .views = view_plan,
                                      .n_views = views->n,
                                      .lights = light_plan,
                                      .n_lights = lights->n};
    g_autoptr(GError) error = NULL;
    g_autoptr(Session) session = session_create(path, name, &texts, &plan, &error);
    g_assert_no_error(error);
    for (int view = 0; view < views->n; view++) {
        struct exr_file *file = exr_file_new();
        g_autofree char *relative = g_strdup_printf("products/btf/view_%04d.exr", view);
        g_autofree char *to = session_file(session, relative);
        for (int light = 0; light < lights->n; light++)
            exr_file_add(file, near_field_make_part(views, lights, view, light, wish));
        ok(exr_write(to, file, EXR_NONE, FALSE, ERR));
        exr_file_free(file);
    }
    return path;
}

char *near_field_resample(const char *session, const char *name, const struct btf_directions *to,
                          struct near_field_correction_result *ret) {
    char *path = g_strdup_printf("%s/%s.session", near_folder, name);
    ok(near_field_correct(session, path, to, &quiet, ret, ERR));
    return path;
}

struct exr_file *near_field_read_view(const char *session, int view) {
    g_autofree char *path = g_strdup_printf("%s/products/btf/view_%04d.exr", session, view);
    struct exr_file *file = ok(exr_read(path, ERR));
    return file;
}
