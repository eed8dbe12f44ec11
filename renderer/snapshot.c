#include "snapshot.h"

#include "picture.h"

/* As people name it, "weave.session/products/eigenmaps.exr": where it lay on this machine is
 * nobody's business who is sent the picture. */
static char *shown_name(const char *path) {
    g_autofree char *name = g_path_get_basename(path), *folder = g_path_get_dirname(path);
    g_autofree char *folder_name = g_path_get_basename(folder);
    g_autofree char *session = g_path_get_dirname(folder);
    g_autofree char *session_name = g_path_get_basename(session);
    if (!g_str_equal(folder_name, "products"))
        return g_steal_pointer(&name);
    return g_build_filename(session_name, folder_name, name, NULL);
}

static char *source_of(const struct snapshot *snapshot) {
    static const char *const joined[COMPOSE_MODES] = {"", ", and on the right ",
                                                      ", and how much brighter is "};
    const gboolean two = snapshot->second != NULL;
    return g_strconcat(snapshot->reference ? "the whole BTF" : snapshot->first->title,
                       two ? joined[snapshot->how->mode] : NULL,
                       two ? snapshot->second->title : NULL, NULL);
}

static const char *relief_of(const struct view_settings *s) {
    return s->silhouettes && s->shadows ? "silhouettes, shadows"
           : s->silhouettes             ? "silhouettes"
           : s->shadows                 ? "shadows"
                                        : "none";
}

/* All of them, as --lamp takes them. */
static char *lamps_of(const struct view_settings *s) {
    GString *text = g_string_new(NULL);
    g_string_printf(text, "first %.10g, and %d more", s->lamp, s->n_lamps);
    for (int k = 0; k < s->n_lamps; k++) {
        const struct view_lamp *l = &s->lamps[k];
        g_string_append_printf(text, "%s%.6g,%.6g,%.6g,%.6g,%.6g", k == 0 ? ": " : "; ",
                               l->theta_deg, l->phi_deg, (double)l->rgb[0], (double)l->rgb[1],
                               (double)l->rgb[2]);
    }
    return g_string_free(text, FALSE);
}

static char *environment_of(const struct snapshot *snapshot) {
    g_autofree char *name =
        snapshot->environment != NULL ? g_path_get_basename(snapshot->environment) : NULL;
    return g_strdup_printf("%s%s", name != NULL ? name : "none",
                           snapshot->settings->backdrop ? ", seen behind the shape" : "");
}

/* Whichever of the pictures is there. */
static gboolean write_either(const char *path, const struct snapshot *snapshot, const guint8 *rgb,
                             const float *linear, int width, int height, GError **error) {
    static const char *const rotations[METHOD_ROTATIONS] = {"exact", "approximate", "none"};
    const struct view_settings *s = snapshot->settings;
    g_autofree char *light =
        g_strdup_printf("theta %.10g deg, phi %.10g deg", s->light_theta_deg, s->light_phi_deg);
    g_autofree char *camera = g_strdup_printf(
        "azimuth %.10g deg, elevation %.10g deg, distance %.10g, fov %.10g deg",
        s->camera_azimuth_deg, s->camera_elevation_deg, s->camera_distance, s->camera_fov_deg);
    g_autofree char *tiles = g_strdup_printf("%.10g x %.10g", s->tiles_u, s->tiles_v);
    g_autofree char *exposure =
        g_strdup_printf("%.10g EV, ambient %.10g", s->exposure_ev, s->ambient);
    g_autofree char *lamps = lamps_of(s), *environment = environment_of(snapshot);
    g_autofree char *name = shown_name(snapshot->material);
    g_autofree char *source = source_of(snapshot);
    g_autofree char *views =
        g_strdup_printf("%d of %d; where the nearest to the line of sight is missing, striped",
                        snapshot->n_views, snapshot->n_planned);
    const char *texts[] = {"Software",
                           "mesorig-view " MESORIG_VERSION,
                           "Material",
                           name,
                           "Shape",
                           snapshot->shape,
                           "Tiles",
                           tiles,
                           "Light",
                           light,
                           "Lamps",
                           lamps,
                           "Environment",
                           environment,
                           "Camera",
                           camera,
                           "Exposure",
                           exposure,
                           "Relief",
                           relief_of(s),
                           "Rotation",
                           rotations[s->style.rotation],
                           "Source",
                           source,
                           snapshot->n_planned > 0 ? "Views" : NULL,
                           views,
                           NULL};
    return linear != NULL ? picture_write_exr(path, linear, width, height, texts, error)
                          : picture_write_png(path, rgb, width, height, texts, error);
}

gboolean snapshot_write(const char *path, const struct snapshot *snapshot, const guint8 *rgb,
                        int width, int height, GError **error) {
    return write_either(path, snapshot, rgb, NULL, width, height, error);
}

gboolean snapshot_write_light(const char *path, const struct snapshot *snapshot, const float *rgb,
                              int width, int height, GError **error) {
    return write_either(path, snapshot, NULL, rgb, width, height, error);
}
