#include "programs.h"

#include "camera.h"
#include "drawing/gl/gpu.h"
#include "lamp.h"

#include <epoxy/gl.h>
#include <string.h>

#define OTHERS 12 /* maximum number of shaders in addition to the shaders of the method */

struct Programs {
    const struct method *method;
    GHashTable *compiled; /* programs by kind and constants */
};

static void delete_program(gpointer program) {
    glDeleteProgram(GPOINTER_TO_UINT(program));
}

Programs *programs_new(const struct method *method) {
    Programs *programs = g_new(Programs, 1);
    programs->method = method;
    programs->compiled = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, delete_program);
    return programs;
}

void programs_free(Programs *programs) {
    if (programs == NULL)
        return;
    g_hash_table_unref(programs->compiled);
    g_free(programs);
}

guint programs_get(Programs *programs, enum program_kind kind, gconstpointer material,
                   const struct places_source *places, const struct viewer_settings *s,
                   GError **error) {
    static const char *const before[] = {"mesh.vert", "frame.glsl", "places.glsl",
                                         "directions.glsl", NULL};
    static const char *const before_flat[] = {"screen.vert", "flat.glsl", "places.glsl",
                                              "directions.glsl", NULL};
    static const char *const after[][8] = {
        {"further.glsl", "lamps.glsl", "surface.frag", NULL},
        {"shadow.glsl", "further.glsl", "lamps.glsl", "visible.glsl", "curved.glsl", "along.glsl",
         "surface_relief.frag", NULL},
        {"flat.frag", NULL},
    };
    static const char no_first[] = "#define NO_FIRST_LAMP\n";
    const struct method *method = programs->method;
    g_autofree char *own = method->constants ? method->constants(material, &s->style) : NULL;
    g_autofree char *of_places = places_constants(places, s->style.nearest);
    g_autofree char *constants =
        g_strdup_printf("%s#define CURVED %d\n#define ALONG %d\n#define "
                        "LAMPS %d\n#define "
                        "LAMP_SHADOWS %d\n#define "
                        "AMBIENT %d\n%s%s%s%s",
                        s->light_size_deg > 0.0 ? "#define SOFT_SHADOWS\n" : "",
                        kind == PROGRAM_RELIEF, kind == PROGRAM_RELIEF && s->along_surface,
                        s->n_lamps > 0, kind == PROGRAM_RELIEF && s->shadows && s->n_lamps > 0,
                        s->ambient > 0, s->lamp > 0 || s->ambient > 0 ? "" : no_first,
                        lamp_any_near(s) ? "#define NEAR_LAMPS\n" : "", of_places, own ? own : "");
    g_autofree char *key = g_strdup_printf("%d %s", kind, constants);
    guint program = GPOINTER_TO_UINT(g_hash_table_lookup(programs->compiled, key));
    if (program != 0)
        return program;
    const char *const *const lists[] = {kind == PROGRAM_FLAT ? before_flat : before,
                                        method->shaders, after[kind]};
    const char *names[METHOD_SHADERS + OTHERS] = {NULL};
    int n = 0;
    for (gsize list = 0; list < G_N_ELEMENTS(lists); list++)
        for (int k = 0; lists[list][k] != NULL; k++)
            names[n++] = lists[list][k];
    if ((program = gpu_program(constants, names, error)) != 0)
        g_hash_table_insert(programs->compiled, g_steal_pointer(&key), GUINT_TO_POINTER(program));
    return program;
}

void programs_set_lamps(guint program, const struct viewer_settings *s, double radius) {
    float places[VIEWER_MAX_LAMPS][4], cones[VIEWER_MAX_LAMPS][4], towards[VIEWER_MAX_LAMPS][3];
    float colours[VIEWER_MAX_LAMPS][3];
    const int n = s->n_lamps;
    for (int k = 0; k < n; k++) {
        const struct shadow_lamp placed = lamp_placed(&s->lamps[k], radius);
        memcpy(places[k], placed.place, sizeof places[k]);
        memcpy(towards[k], placed.place, sizeof towards[k]);
        memcpy(colours[k], s->lamps[k].rgb, sizeof colours[k]);
        lamp_cone(&placed, s->lamps[k].inner_deg, cones[k]);
    }
    glUniform1f(glGetUniformLocation(program, "lamp"), (float)s->lamp);
    glUniform1i(glGetUniformLocation(program, "n_lamps"), n);
    if (n == 0)
        return;
    /* A program has either lamp_places (with NEAR_LAMPS) or lamp_towards. OpenGL ignores a uniform
     * that the program does not have. */
    glUniform4fv(glGetUniformLocation(program, "lamp_places"), n, places[0]);
    glUniform3fv(glGetUniformLocation(program, "lamp_towards"), n, towards[0]);
    glUniform4fv(glGetUniformLocation(program, "lamp_cones"), n, cones[0]);
    glUniform3fv(glGetUniformLocation(program, "lamp_colours"), n, colours[0]);
}
