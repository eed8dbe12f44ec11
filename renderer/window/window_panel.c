#include "window_private.h"

#include <math.h>
#include <string.h>

static gboolean choose_method(const char *label, const struct method *now,
                              const struct method **ret) {
    const char *titles[64];
    int n = 0, chosen = 0;
    for (; methods[n] != NULL && n < (int)G_N_ELEMENTS(titles); n++) {
        titles[n] = methods[n]->title;
        chosen = methods[n] == now ? n : chosen;
    }
    const gboolean changed = ui_choice(label, titles, n, &chosen);
    *ret = methods[chosen];
    return changed && methods[chosen] != now;
}

static gboolean has_microfacets(const struct method *method) {
    return method != NULL && g_strv_contains(method->shaders, "microfacet.glsl");
}

static const char *label_of(enum setting_id id) {
    return settings_table[id].label;
}

gboolean window_draw_setting(struct window *w, enum setting_id id) {
    const struct setting *setting = &settings_table[id];
    void *value = (char *)&w->now + setting->offset;
    gboolean changed = FALSE;
    if (setting->kind == SETTING_FLAG) {
        changed = ui_check(setting->label, value);
    } else if (setting->kind == SETTING_NUMBER) {
        changed = ui_slider(setting->label, value, setting->low, setting->high, setting->format);
    } else if (setting->kind == SETTING_WHOLE) {
        double number = *(int *)value;
        changed = ui_slider(setting->label, &number, setting->low, setting->high, setting->format);
        *(int *)value = (int)lround(number);
    }
    w->stale |= changed;
    return changed;
}

static void draw_methods(struct window *w) {
    static const char *const modes[COMPOSE_MODES] = {"one picture", "split", "difference"};
    const struct method *method = NULL, *second = NULL;
    struct viewer_options *now = &w->now;
    int mode = (int)now->compose.mode, rotation = (int)now->settings.style.rotation;
    if (choose_method(label_of(SETTING_METHOD), now->method, &method))
        window_set_method(w, method);
    second = now->second != NULL ? now->second : now->method;
    if (ui_choice(label_of(SETTING_SPLIT), modes, COMPOSE_MODES, &mode))
        window_set_second(w, second, (enum compose_mode)mode);
    if (now->compose.mode != COMPOSE_ONE &&
        choose_method(label_of(SETTING_DIFFERENCE), second, &second))
        window_set_second(w, second, now->compose.mode);
    if (now->compose.mode == COMPOSE_SPLIT)
        window_draw_setting(w, SETTING_SPLIT_AT);
    if (now->compose.mode == COMPOSE_DIFFERENCE)
        window_draw_setting(w, SETTING_DIFFERENCE_GAIN);
    if (now->method == methods[0])
        window_draw_setting(w, SETTING_PLAIN);
    window_draw_setting(w, SETTING_NEAREST);
    if (!has_microfacets(now->method) &&
        (now->compose.mode == COMPOSE_ONE || !has_microfacets(now->second)))
        return;
    if (ui_choice(label_of(SETTING_ROTATION), method_rotation_names, METHOD_ROTATIONS, &rotation)) {
        now->settings.style.rotation = (enum method_rotation)rotation;
        w->stale = TRUE;
    }
}

static void draw_shape(struct window *w) {
    const char *names[SCENE_SHAPES + 1];
    memcpy(names, scene_shape_names, sizeof scene_shape_names);
    g_autofree char *own_name = g_path_get_basename(w->own_shape);
    names[SCENE_SHAPES] = w->own_shape;
    const int own = SCENE_SHAPES;
    int chosen = 0, n = 0;
    while (!g_str_equal(names[n], names[own]))
        n++;
    n = n < own ? own : own + 1; /* a file has its own entry after the computed shapes */
    while (chosen < n - 1 && !g_str_equal(names[chosen], w->now.shape))
        chosen++;
    names[own] = own_name;
    if (ui_choice(label_of(SETTING_SHAPE), names, n, &chosen))
        window_set_shape(w, chosen == own ? w->own_shape : names[chosen],
                         chosen == own && w->own_shape == w->start->shape ? &w->start->settings
                                                                          : NULL);
    double tiles = w->now.settings.tiles_u;
    if (ui_slider_log(label_of(SETTING_TILES), &tiles, 0.125, 256.0, "%.2f"))
        window_scale_tiles(w, tiles / w->now.settings.tiles_u);
    if (w->now.method != NULL && w->now.method->product != NULL && w->now.index_path == NULL)
        window_draw_setting(w, SETTING_ENDLESS);
    gboolean silhouettes = w->now.settings.silhouettes;
    if (ui_check(label_of(SETTING_SILHOUETTES), &silhouettes))
        window_toggle_silhouettes(w);
    ui_same_line();
    window_draw_setting(w, SETTING_SHADOWS);
    if (silhouettes)
        window_draw_setting(w, SETTING_ALONG_SURFACE);
}

static void draw_camera(struct window *w) {
    struct viewer_settings *s = &w->now.settings;
    const double azimuth = s->camera_azimuth_deg;
    s->camera_azimuth_deg = azimuth - 360.0 * floor((azimuth + 180.0) / 360.0);
    if (!window_draw_setting(w, SETTING_CAMERA_AZIMUTH))
        s->camera_azimuth_deg = azimuth;
    window_draw_setting(w, SETTING_CAMERA_ELEVATION);
    window_draw_setting(w, SETTING_CAMERA_DISTANCE);
    window_draw_setting(w, SETTING_CAMERA_FOV);
    w->stale |= ui_pair(label_of(SETTING_CAMERA_PAN), s->camera_pan, -3.0, 3.0, "%.2f");
}

static void draw_views(struct window *w) {
    const double theta = 90.0 - w->now.settings.camera_elevation_deg;
    const double phi = w->now.settings.camera_azimuth_deg;
    const struct ui_dot camera = {MAX(theta, 0.0), phi, UI_DOT_CAMERA};
    double unused[2];
    g_autoptr(GArray) dots = g_array_new(FALSE, FALSE, sizeof(struct ui_dot));
    guint there = 0;
    for (guint k = 0; k < w->planned->len; k++) {
        const struct planned_view *v = &g_array_index(w->planned, struct planned_view, k);
        const struct ui_dot dot = {v->theta_deg, v->phi_deg,
                                   v->measured ? UI_DOT_THERE : UI_DOT_MISSING};
        there += v->measured;
        g_array_append_val(dots, dot);
    }
    g_array_append_val(dots, camera);
    g_autofree char *text = g_strdup_printf("%u of %u views exist", there, w->planned->len);
    ui_text(text);
    if (there < w->planned->len &&
        planned_views_missing((const struct planned_view *)(const void *)w->planned->data,
                              w->planned->len, theta, phi))
        ui_note(
            "The view nearest to the camera does not exist yet, so the picture is interpolated.");
    ui_hemisphere("views", (const struct ui_dot *)(const void *)dots->data, (int)dots->len,
                  150.0F * ui_scale(), &unused[0], &unused[1]);
}

static void draw_measured(struct window *w) {
    if (ui_check(label_of(SETTING_MEASURED), &w->show_measured) && w->show_measured)
        window_compare_measured(w);
    if (!w->show_measured || w->measured_texture == 0)
        return;
    if (ui_button("the one nearest now"))
        window_compare_measured(w);
    const struct measured *m = &w->measured;
    g_autofree char *text = g_strdup_printf(
        "measured | drawn | 4 × difference\nview θ %.0f° φ %.0f°, light θ %.0f° φ %.0f°: "
        "%.1f %% off",
        m->view_theta_deg, m->view_phi_deg, m->light_theta_deg, m->light_phi_deg, 100.0 * m->error);
    ui_text(text);
    const float width = (WINDOW_PANEL - 36.0F) * ui_scale();
    ui_picture(w->measured_texture, width, width * (float)m->height / (float)m->width);
}

static void draw_commands(struct window *w) {
    if (ui_button("Open …"))
        window_ask_file(w, CHOOSER_FILE);
    ui_same_line();
    if (ui_button("Save …"))
        window_ask_file(w, CHOOSER_SAVE);
    ui_same_line();
    if (ui_button("Keys"))
        window_show_page(w, WINDOW_KEYS);
    ui_column((WINDOW_PANEL - 46.0F) * ui_scale());
    if (ui_button("«")) {
        w->panel = FALSE;
        w->frames_due = WINDOW_FRAMES;
    }
}

static void draw_state(struct window *w) {
    g_autofree char *name =
        g_path_get_basename(w->now.argument != NULL ? w->now.argument : w->material);
    const struct viewer_memory bytes = viewer_memory(w->viewer);
    g_autofree char *mdf =
        bytes.mdf > 0 ? g_strdup_printf(", MDF %.1f MB", (double)bytes.mdf * 1e-6) : g_strdup("");
    const gboolean slow = w->frame_ms >= 1000.0;
    g_autofree char *state = g_strdup_printf("%.*f %s a picture, %.1f MB on the card%s",
                                             slow ? 1 : 0, slow ? w->frame_ms * 1e-3 : w->frame_ms,
                                             slow ? "s" : "ms", (double)bytes.material * 1e-6, mdf);
    g_autofree char *opening = opener_progress(w->opener);
    ui_text(name);
    ui_text(opening != NULL ? opening : state);
    if (w->live != NULL && w->live_maps == NULL)
        ui_note("Waiting for the first picture of the session; until then, a demonstration is "
                "shown.");
    if (w->live != NULL && live_text(w->live) != NULL)
        ui_text(live_text(w->live));
}

void window_draw_panel(struct window *w, struct ui_box box) {
    if (box.width <= 0.0F || w->opener == NULL)
        return;
    ui_panel_begin("panel", box);
    draw_commands(w);
    draw_state(w);
    if (ui_section("material", TRUE))
        draw_methods(w);
    if (ui_section("shape", TRUE))
        draw_shape(w);
    if (ui_section("light", TRUE)) {
        window_draw_lamps(w);
        window_draw_setting(w, SETTING_AMBIENT);
        window_draw_setting(w, SETTING_EXPOSURE);
        ui_histogram(w->histogram, WINDOW_BINS, (WINDOW_PANEL - 36.0F) * ui_scale(),
                     50.0F * ui_scale());
    }
    if (ui_section("camera", FALSE))
        draw_camera(w);
    if (w->planned != NULL && ui_section("views", TRUE))
        draw_views(w);
    if (w->session != NULL && ui_section("measured", TRUE))
        draw_measured(w);
    ui_text(gpu_renderer());
    ui_end_window();
}
