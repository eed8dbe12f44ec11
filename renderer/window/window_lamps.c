/* Lamps and the environment, and their part of the panel. */
#include "window_private.h"

#include <math.h>
#include <string.h>

#define GLYPH 150.0F /* width of the hemisphere in the panel, multiplied by ui_scale() */

void window_relight(struct window *w) {
    struct viewer_settings *s = &w->now.settings;
    g_autoptr(GError) error = NULL;
    s->n_lamps = w->n_lamps;
    if (w->environment != NULL && !environment_light(w->environment, s, &error))
        window_say(w, error->message);
    w->lamp = MIN(w->lamp, w->n_lamps + (w->environment != NULL));
    w->stale = TRUE;
}

/* Sets the environment and takes ownership of it. NULL for both arguments removes the present
 * environment. */
void window_set_environment(struct window *w, struct environment *environment, const char *name) {
    struct viewer_settings *s = &w->now.settings;
    const gboolean had = w->environment != NULL, first = !w->first_open;
    environment_free(w->environment);
    w->environment = environment;
    w->now.environment = name != NULL ? g_string_chunk_insert_const(w->texts, name) : NULL;
    if (name != NULL && !g_strv_contains(environment_names, name))
        w->own_environment = w->now.environment;
    /* This is the environment of the command line. The brightness of the lamp and of the sky are
     * then those of the command line, too. */
    if (first) {
        s->lamp = w->start->settings.lamp;
        s->ambient = w->start->settings.ambient;
    } else if (had != (environment != NULL)) {
        viewer_options_default_light(s, environment != NULL);
    }
    s->backdrop = environment != NULL && (first ? w->start->settings.backdrop : s->backdrop);
    window_relight(w);
}

void window_add_lamp(struct window *w) {
    struct viewer_settings *s = &w->now.settings;
    /* one lamp is reserved for a near light */
    if (w->n_lamps >= VIEWER_MAX_LAMPS - 1 - (w->environment != NULL)) {
        g_autofree char *why = g_strdup_printf(
            "There are %d lamps in addition to the first already; remove one.", w->n_lamps);
        window_say(w, why);
        return;
    }
    s->lamps[w->n_lamps++] = (struct viewer_lamp){.theta_deg = 45.0,
                                                  .phi_deg = s->light_phi_deg + 120.0 * w->n_lamps,
                                                  .rgb = {0.5F, 0.5F, 0.5F}};
    w->lamp = w->n_lamps;
    window_relight(w);
}

void window_remove_lamp(struct window *w) {
    struct viewer_settings *s = &w->now.settings;
    if (w->lamp == 0) {
        /* the first lamp is only switched off; setting its brightness switches it on again */
        s->lamp = 0.0;
    } else if (w->lamp > w->n_lamps) {
        window_set_environment(w, NULL, NULL);
    } else {
        memmove(&s->lamps[w->lamp - 1], &s->lamps[w->lamp],
                sizeof *s->lamps * (gsize)(w->n_lamps - w->lamp));
        w->n_lamps--;
        w->lamp--;
    }
    window_relight(w);
}

static double around(double deg) {
    return deg - 360.0 * floor(deg / 360.0);
}

/* Turns the environment's lamps without cutting the environment into lamps again. */
static void turn_environment(struct window *w, double to_deg) {
    struct viewer_settings *s = &w->now.settings;
    for (int k = w->n_lamps; k < s->n_lamps; k++)
        s->lamps[k].phi_deg += to_deg - s->environment_turn_deg;
    s->environment_turn_deg = to_deg;
    w->stale = TRUE;
}

void window_move_lamp(struct window *w, double by_theta_deg, double by_phi_deg) {
    struct viewer_settings *s = &w->now.settings;
    if (w->lamp > w->n_lamps) {
        turn_environment(w, around(s->environment_turn_deg + by_phi_deg));
        return;
    }
    double *theta = w->lamp == 0 ? &s->light_theta_deg : &s->lamps[w->lamp - 1].theta_deg;
    double *phi = w->lamp == 0 ? &s->light_phi_deg : &s->lamps[w->lamp - 1].phi_deg;
    *theta = CLAMP(*theta + by_theta_deg, 0.0, 180.0);
    *phi = fmod(*phi + by_phi_deg, 360.0);
    w->stale = TRUE;
}

void window_toggle_backdrop(struct window *w) {
    if (w->environment == NULL)
        window_say(w, "There is no environment to show; choose one in the panel.");
    else
        w->now.settings.backdrop = !w->now.settings.backdrop;
    w->stale = TRUE;
}

static void draw_glyph(struct window *w) {
    const struct viewer_settings *s = &w->now.settings;
    struct ui_dot dots[VIEWER_MAX_LAMPS + 2];
    int n = 0;
    double theta = 0.0, phi = 0.0;
    for (int k = 0; k <= w->n_lamps; k++)
        dots[n++] = (struct ui_dot){k == 0 ? s->light_theta_deg : s->lamps[k - 1].theta_deg,
                                    k == 0 ? s->light_phi_deg : s->lamps[k - 1].phi_deg,
                                    k == w->lamp ? UI_DOT_CHOSEN_LIGHT : UI_DOT_LIGHT};
    dots[n++] = (struct ui_dot){MAX(90.0 - s->camera_elevation_deg, 0.0), s->camera_azimuth_deg,
                                UI_DOT_CAMERA};
    const int held = ui_hemisphere("lamps", dots, n, GLYPH * ui_scale(), &theta, &phi);
    if (held < 0)
        return;
    w->lamp = held;
    if (theta != dots[held].theta_deg || phi != dots[held].phi_deg)
        window_move_lamp(w, theta - dots[held].theta_deg, phi - dots[held].phi_deg);
}

/* Draws a slider for a value of a lamp. Label, range and format are those that settings_table has
 * for the first lamp. */
static void lamp_slider(struct window *w, enum setting_id id, double *value) {
    const struct setting *setting = &settings_table[id];
    w->stale |= ui_slider(setting->label, value, setting->low, setting->high, setting->format);
}

/* Draws the controls of a lamp's distance and cone. A lamp far away has no cone. */
static void draw_lamp_place(struct window *w, double *distance, double *cone, double *inner) {
    lamp_slider(w, SETTING_LIGHT_DISTANCE, distance);
    if (*distance == 0.0)
        return;
    lamp_slider(w, SETTING_LIGHT_CONE, cone);
    if (*cone > 0.0)
        lamp_slider(w, SETTING_LIGHT_INNER, inner);
}

static void draw_chosen_lamp(struct window *w) {
    struct viewer_settings *s = &w->now.settings;
    if (w->lamp == 0) {
        const double phi = s->light_phi_deg;
        s->light_phi_deg = around(phi);
        window_draw_setting(w, SETTING_LIGHT_THETA);
        if (!window_draw_setting(w, SETTING_LIGHT_PHI))
            s->light_phi_deg = phi;
        window_draw_setting(w, SETTING_LIGHT_BRIGHTNESS);
        if (s->shadows && s->light_distance == 0.0)
            window_draw_setting(w, SETTING_LIGHT_SIZE);
        draw_lamp_place(w, &s->light_distance, &s->light_cone_deg, &s->light_inner_deg);
    } else if (w->lamp <= w->n_lamps) {
        struct viewer_lamp *lamp = &s->lamps[w->lamp - 1];
        double phi = around(lamp->phi_deg);
        w->stale |= ui_slider("θ", &lamp->theta_deg, 0.0, 180.0, "%.0f°");
        if (ui_slider("φ", &phi, 0.0, 360.0, "%.0f°")) {
            lamp->phi_deg = phi;
            w->stale = TRUE;
        }
        w->stale |= ui_colour("colour", lamp->rgb);
        draw_lamp_place(w, &lamp->distance, &lamp->cone_deg, &lamp->inner_deg);
    } else {
        double turn = around(s->environment_turn_deg);
        if (ui_slider(settings_table[SETTING_ENVIRONMENT_TURN].label, &turn, 0.0, 360.0, "%.0f°"))
            turn_environment(w, turn);
        if (window_draw_setting(w, SETTING_ENVIRONMENT_LAMPS))
            window_relight(w);
        window_draw_setting(w, SETTING_BACKDROP);
    }
}

static void choose_lamp(struct window *w) {
    g_autoptr(GPtrArray) names = g_ptr_array_new_with_free_func(g_free);
    for (int k = 0; k <= w->n_lamps; k++)
        g_ptr_array_add(names, g_strdup_printf("lamp %d", k + 1));
    if (w->environment != NULL)
        g_ptr_array_add(names, g_strdup("environment"));
    ui_choice(settings_table[SETTING_LAMP].label, (const char *const *)names->pdata,
              (int)names->len, &w->lamp);
    draw_chosen_lamp(w);
    if (ui_button("add a lamp"))
        window_add_lamp(w);
    ui_same_line();
    if (ui_button(w->lamp == 0 ? "switch it off" : "remove it"))
        window_remove_lamp(w);
}

static void choose_environment(struct window *w) {
    const char *names[8] = {"none"};
    g_autofree char *own =
        w->own_environment != NULL ? g_path_get_basename(w->own_environment) : NULL;
    int n = 1, chosen = 0;
    for (int k = 0; environment_names[k] != NULL; k++, n++) {
        names[n] = environment_names[k];
        chosen = g_strcmp0(w->now.environment, names[n]) == 0 ? n : chosen;
    }
    if (own != NULL) {
        names[n] = own;
        chosen = w->now.environment != NULL && chosen == 0 ? n : chosen;
        n++;
    }
    if (!ui_choice(settings_table[SETTING_ENVIRONMENT].label, names, n, &chosen))
        return;
    if (chosen == 0)
        window_set_environment(w, NULL, NULL);
    else
        window_ask_environment(w,
                               own != NULL && chosen == n - 1 ? w->own_environment : names[chosen]);
}

void window_draw_lamps(struct window *w) {
    choose_environment(w);
    choose_lamp(w);
    draw_glyph(w);
}
