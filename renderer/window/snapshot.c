#include "snapshot.h"

#include "scene/picture.h"

/* Returns the end of a path. The full path is not written, because the recipient of a picture must
 * not learn it. For a product of a session, the result is such as
 * "weave.session/products/eigenmaps.exr". For any other file, it is the name of the file. */
static char *shown_name(const char *path) {
    g_autofree char *name = g_path_get_basename(path), *folder = g_path_get_dirname(path);
    g_autofree char *folder_name = g_path_get_basename(folder);
    g_autofree char *session = g_path_get_dirname(folder);
    g_autofree char *session_name = g_path_get_basename(session);
    if (!g_str_equal(folder_name, "products"))
        return g_steal_pointer(&name);
    return g_build_filename(session_name, folder_name, name, NULL);
}

/* Returns the name of a file without its folder, or NULL for NULL. */
static char *file_of(const char *path) {
    return path != NULL ? g_path_get_basename(path) : NULL;
}

/* Describes all lamps. The further lamps are written in the form of --lamp. */
static char *lamps_of(const struct viewer_settings *s) {
    GString *text = g_string_new(NULL);
    g_string_printf(text, "first %.10g, and %d more", s->lamp, s->n_lamps);
    for (int k = 0; k < s->n_lamps; k++) {
        const struct viewer_lamp *l = &s->lamps[k];
        g_string_append_printf(text, "%s%.6g,%.6g,%.6g,%.6g,%.6g", k == 0 ? ": " : "; ",
                               l->theta_deg, l->phi_deg, (double)l->rgb[0], (double)l->rgb[1],
                               (double)l->rgb[2]);
        if (l->distance > 0.0)
            g_string_append_printf(text, ",%.6g,%.6g,%.6g", l->distance, l->cone_deg, l->inner_deg);
    }
    return g_string_free(text, FALSE);
}

/* Describes the position of the first lamp. */
static char *light_of(const struct viewer_settings *s) {
    GString *text = g_string_new(NULL);
    g_string_printf(text, "theta %.10g deg, phi %.10g deg", s->light_theta_deg, s->light_phi_deg);
    if (s->light_distance > 0.0)
        g_string_append_printf(text, ", distance %.10g", s->light_distance);
    if (s->light_distance > 0.0 && s->light_cone_deg > 0.0)
        g_string_append_printf(text, ", cone %.10g deg, full within %.10g deg", s->light_cone_deg,
                               s->light_inner_deg);
    return g_string_free(text, FALSE);
}

/* Describes the settings that differ from the defaults, and the number of samples. */
static char *drawn_of(const struct viewer_settings *s) {
    GString *text = g_string_new(NULL);
    g_string_printf(text, "%d x %d samples per pixel", s->samples, s->samples);
    if (s->plain)
        g_string_append(text, ", one texture times the cosine");
    if (s->endless)
        g_string_append(text, ", endless");
    if (s->style.nearest)
        g_string_append(text, ", texels not filtered");
    if (s->silhouettes && s->visibility.straight)
        g_string_append(text, ", rays straight");
    if (s->silhouettes && s->visibility.volume)
        g_string_append(text, ", distances in a volume");
    if (s->silhouettes && s->visibility.views)
        g_string_append(text, ", distances of the nearest views");
    if (s->silhouettes && s->along_surface)
        g_string_append(text, ", views along the surface");
    if (s->silhouettes && s->visibility.layers != viewer_settings_default.visibility.layers)
        g_string_append_printf(text, ", %d layers", s->visibility.layers);
    if (s->shadows)
        g_string_append_printf(text, ", shadow map %d", s->shadow_size);
    if (s->shadows && s->light_size_deg > 0.0)
        g_string_append_printf(text, ", light of %g°", s->light_size_deg);
    return g_string_free(text, FALSE);
}

/* Returns a description of the materials of a scene, such as "floor=weave.session, 4 tiles; …".
 * Returns NULL if there are none. */
static char *materials_of(const struct viewer_options *o) {
    GString *text = g_string_new(NULL);
    for (int k = 0; k < o->n_bindings; k++) {
        g_autofree char *name = shown_name(o->bindings[k].path);
        g_string_append_printf(text, "%s%s=%s, %.10g tiles", k > 0 ? "; " : "", o->bindings[k].name,
                               name, o->bindings[k].tiles);
    }
    return g_string_free(text, o->n_bindings == 0);
}

/* Adds a text. Takes ownership of value. Adds nothing if value is NULL. */
static void add_text(GPtrArray *texts, const char *name, char *value) {
    if (value == NULL)
        return;
    g_ptr_array_add(texts, g_strdup(name));
    g_ptr_array_add(texts, value);
}

static GPtrArray *texts_of(const struct snapshot *snapshot) {
    static const char *const joined[COMPOSE_MODES] = {"", ", and on the right ",
                                                      ", and how much brighter is "};
    static const char *const reliefs[] = {"none", "silhouettes", "shadows", "silhouettes, shadows"};
    const struct viewer_settings *s = snapshot->settings;
    const struct viewer_options *o = snapshot->options;
    const struct compose *how = snapshot->how;
    const gboolean two = snapshot->second != NULL;
    g_autofree char *environment = file_of(o->environment);
    g_autofree char *turned =
        environment != NULL && s->environment_turn_deg != 0.0
            ? g_strdup_printf(", turned by %.10g deg", s->environment_turn_deg)
            : g_strdup("");
    GPtrArray *texts = g_ptr_array_new_with_free_func(g_free);
    add_text(texts, "Software", g_strdup("mesorig-view " MESORIG_VERSION));
    add_text(texts, "Material", shown_name(snapshot->material));
    add_text(texts, "Shape", file_of(snapshot->shape));
    add_text(texts, "Materials", materials_of(o));
    add_text(texts, "Floor", o->floor ? g_strdup("of the material") : NULL);
    add_text(texts, "Tiles", g_strdup_printf("%.10g x %.10g", s->tiles_u, s->tiles_v));
    add_text(texts, "Light", light_of(s));
    add_text(texts, "Lamps", lamps_of(s));
    add_text(texts, "Environment",
             g_strconcat(environment != NULL ? environment : "none", turned,
                         s->backdrop ? ", seen behind the shape" : "", NULL));
    add_text(
        texts, "Camera",
        g_strdup_printf("azimuth %.10g deg, elevation %.10g deg, distance %.10g, pan %.10g %.10g, "
                        "fov %.10g deg",
                        s->camera_azimuth_deg, s->camera_elevation_deg, s->camera_distance,
                        s->camera_pan[0], s->camera_pan[1], s->camera_fov_deg));
    add_text(texts, "Exposure",
             g_strdup_printf("%.10g EV, ambient %.10g", s->exposure_ev, s->ambient));
    add_text(texts, "Relief", g_strdup(reliefs[!!s->silhouettes + 2 * !!s->shadows]));
    add_text(texts, "Distances", s->silhouettes ? file_of(o->mdf_path) : NULL);
    add_text(texts, "Index", file_of(o->index_path));
    add_text(texts, "Rotation", g_strdup(method_rotation_names[s->style.rotation]));
    add_text(texts, "Normals", file_of(o->normal_map));
    add_text(texts, "Source",
             g_strconcat(snapshot->reference ? "the whole BTF" : snapshot->first->title,
                         two ? joined[how->mode] : NULL, two ? snapshot->second->title : NULL,
                         NULL));
    add_text(texts, "Compare",
             two && how->mode == COMPOSE_SPLIT ? g_strdup_printf("split at %.10g", how->at)
             : two && how->mode == COMPOSE_DIFFERENCE
                 ? g_strdup_printf("difference times %.10g", how->gain)
                 : g_strdup("one picture"));
    add_text(texts, "Drawn", drawn_of(s));
    if (snapshot->n_planned > 0)
        add_text(
            texts, "Views",
            g_strdup_printf("%d of %d; where the nearest to the line of sight is missing, striped",
                            snapshot->n_views, snapshot->n_planned));
    g_ptr_array_add(texts, NULL);
    return texts;
}

gboolean snapshot_write(const char *path, const struct snapshot *snapshot, const guint8 *rgb,
                        const float *light, int width, int height, GError **error) {
    const locale_t before = picture_numbers_begin();
    g_autoptr(GPtrArray) texts = texts_of(snapshot);
    picture_numbers_end(before);
    const char *const *all = (const char *const *)texts->pdata;
    return light != NULL ? picture_write_exr(path, light, width, height, all, error)
                         : picture_write_png(path, rgb, width, height, all, error);
}
