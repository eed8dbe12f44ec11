#include "window_private.h"

#include <math.h>
#include <string.h>

#define WIDTH 300.0F

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

static void draw_methods(struct window *w) {
    static const char *const modes[COMPOSE_MODES] = {"one picture", "split", "difference"};
    const struct method *method = NULL, *second = NULL;
    int mode = (int)w->how.mode, rotation = (int)w->settings.style.rotation;
    if (choose_method("method", w->method, &method))
        window_set_method(w, method);
    second = w->second_method != NULL ? w->second_method : w->method;
    if (ui_choice("compare", modes, COMPOSE_MODES, &mode))
        window_set_second(w, second, (enum compose_mode)mode);
    if (w->how.mode != COMPOSE_ONE && choose_method("with", second, &second))
        window_set_second(w, second, w->how.mode);
    if (w->how.mode == COMPOSE_SPLIT)
        w->stale |= ui_slider("at", &w->how.at, 0.0, 1.0, "%.2f");
    if (w->how.mode == COMPOSE_DIFFERENCE)
        w->stale |= ui_slider("times", &w->how.gain, 1.0, 32.0, "%.0f");
    if (!has_microfacets(w->method) &&
        (w->how.mode == COMPOSE_ONE || !has_microfacets(w->second_method)))
        return;
    if (ui_choice("microfacets turn", method_rotation_names, METHOD_ROTATIONS, &rotation)) {
        w->settings.style.rotation = (enum method_rotation)rotation;
        w->stale = TRUE;
    }
}

static void draw_shape(struct window *w) {
    const char *names[SCENE_SHAPES + 1];
    memcpy(names, scene_shape_names, sizeof scene_shape_names);
    names[SCENE_SHAPES] = w->options->shape;
    const int own = SCENE_SHAPES;
    int chosen = 0, n = 0;
    while (!g_str_equal(names[n], names[own]))
        n++;
    n = n < own ? own : own + 1; /* a file is chosen as the others are */
    while (chosen < n - 1 && !g_str_equal(names[chosen], w->shape))
        chosen++;
    if (ui_choice("shape", names, n, &chosen))
        window_set_shape(w, names[chosen], chosen == own ? &w->options->settings : NULL);
    double tiles = log2(w->settings.tiles_u);
    if (ui_slider("tiles, log2", &tiles, -3.0, 8.0, "%.2f"))
        window_scale_tiles(w, exp2(tiles) / w->settings.tiles_u);
    gboolean silhouettes = w->settings.silhouettes;
    if (ui_check("silhouettes", &silhouettes))
        window_toggle_silhouettes(w);
    w->stale |= ui_check("shadows", &w->settings.shadows);
}

static void draw_light(struct window *w) {
    struct viewer_settings *s = &w->settings;
    double phi = s->light_phi_deg - 360.0 * floor(s->light_phi_deg / 360.0);
    w->stale |= ui_slider("light theta", &s->light_theta_deg, 0.0, 180.0, "%.0f°");
    if (ui_slider("light phi", &phi, 0.0, 360.0, "%.0f°")) {
        s->light_phi_deg = phi;
        w->stale = TRUE;
    }
    gboolean backdrop = s->backdrop;
    if (w->environment != NULL && ui_check("environment behind it", &backdrop))
        window_toggle_backdrop(w);
    w->stale |= ui_slider("ambient", &s->ambient, 0.0, 1.0, "%.2f");
    w->stale |= ui_slider("exposure", &s->exposure_ev, -6.0, 6.0, "%+.2f EV");
    ui_histogram(w->histogram, WINDOW_BINS, WIDTH - 20.0F, 60.0F);
}

static void draw_views(struct window *w) {
    const double theta = 90.0 - w->settings.camera_elevation_deg;
    const double phi = w->settings.camera_azimuth_deg;
    const struct ui_dot camera = {MAX(theta, 0.0), phi, UI_DOT_CAMERA};
    const struct ui_dot light = {w->settings.light_theta_deg, w->settings.light_phi_deg,
                                 UI_DOT_LIGHT};
    g_autoptr(GArray) dots = g_array_new(FALSE, FALSE, sizeof(struct ui_dot));
    guint there = 0;
    for (guint k = 0; k < w->planned->len; k++) {
        const struct planned_view *v = &g_array_index(w->planned, struct planned_view, k);
        const struct ui_dot dot = {v->theta_deg, v->phi_deg,
                                   v->measured ? UI_DOT_THERE : UI_DOT_MISSING};
        there += v->measured;
        g_array_append_val(dots, dot);
    }
    g_array_append_val(dots, light);
    g_array_append_val(dots, camera);
    g_autofree char *text = g_strdup_printf("%u of %u views are there", there, w->planned->len);
    ui_text(text);
    if (there < w->planned->len &&
        planned_views_missing((const struct planned_view *)(const void *)w->planned->data,
                              w->planned->len, theta, phi))
        ui_note("The view nearest to the camera is not there yet: what is seen is interpolated.");
    ui_hemisphere((const struct ui_dot *)(const void *)dots->data, (int)dots->len, 150.0F);
}

static void draw_measured(struct window *w) {
    if (ui_check("compare with the nearest frame", &w->show_measured) && w->show_measured)
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
    const float width = WIDTH - 20.0F;
    ui_picture(w->measured_texture, width, width * (float)m->height / (float)m->width);
}

void window_panel(struct window *w) {
    g_autofree char *name = w->options->argument != NULL ? g_path_get_basename(w->options->argument)
                                                         : g_strdup("no material");
    g_autofree char *time =
        g_strdup_printf("%s: %.1f ms a picture on %s", name, w->frame_ms, gpu_renderer());
    const struct viewer_memory bytes = viewer_memory(w->viewer);
    g_autofree char *memory =
        g_strdup_printf("%.1f MB on the card, its MDF %.1f MB", (double)bytes.material * 1e-6,
                        (double)bytes.mdf * 1e-6);
    if (w->help) {
        ui_panel_begin("Keys", 330.0F, 10.0F, 430.0F);
        g_auto(GStrv) lines = g_strsplit(window_help, "\n", -1);
        for (gsize k = 0; lines[k] != NULL; k++)
            ui_text(lines[k]);
        ui_panel_end();
    }
    if (!w->panel)
        return;
    ui_panel_begin("Mesorig", 10.0F, 10.0F, WIDTH);
    ui_text(time);
    ui_text(memory);
    g_autofree char *opening = opener_progress(w->opener);
    if (opening != NULL)
        ui_note(opening);
    if (w->live != NULL && w->n_live == 0)
        ui_note("Waiting for the first view; this is a demonstration.");
    if (w->message != NULL)
        ui_note(w->message);
    draw_methods(w);
    draw_shape(w);
    draw_light(w);
    if (w->planned != NULL && ui_section("views", TRUE))
        draw_views(w);
    if (w->session != NULL && ui_section("measured", TRUE))
        draw_measured(w);
    if (ui_button("screenshot"))
        window_screenshot(w);
    ui_text("F1: keys");
    ui_panel_end();
}
