#include "programs.h"

#include "base/direction.h"
#include "camera.h"
#include "gl/gpu.h"

#include <epoxy/gl.h>
#include <string.h>

#define OTHERS 11 /* shaders that are not the method's */

struct Programs {
    const struct method *method;
    GHashTable *compiled; /* by kind and constants */
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
    static const char *const before[] = {"mesh.vert", "frame.glsl", "places.glsl", NULL};
    static const char *const before_flat[] = {"screen.vert", "flat.glsl", "places.glsl", NULL};
    static const char *const after[][6] = {
        {"further.glsl", "lamps.glsl", "surface.frag", NULL},
        {"shadow.glsl", "further.glsl", "lamps.glsl", "visible.glsl", "surface_relief.frag", NULL},
        {"flat.frag", NULL},
    };
    const struct method *method = programs->method;
    g_autofree char *own = method->constants ? method->constants(material, &s->style) : NULL;
    g_autofree char *of_places = places_constants(places, s->style.nearest);
    g_autofree char *constants =
        g_strdup_printf("#define LAMPS %d\n#define LAMP_SHADOWS %d\n#define AMBIENT %d\n%s%s",
                        s->n_lamps > 0, kind == PROGRAM_RELIEF && s->shadows && s->n_lamps > 0,
                        s->ambient > 0, of_places, own ? own : "");
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

void programs_set_lamps(guint program, const struct viewer_settings *s) {
    float towards[VIEWER_MAX_LAMPS][3], colours[VIEWER_MAX_LAMPS][3];
    for (int k = 0; k < s->n_lamps; k++) {
        direction_from_deg(s->lamps[k].theta_deg, s->lamps[k].phi_deg, towards[k]);
        memcpy(colours[k], s->lamps[k].rgb, sizeof colours[k]);
    }
    glUniform1f(glGetUniformLocation(program, "lamp"), (float)s->lamp);
    glUniform1i(glGetUniformLocation(program, "n_lamps"), s->n_lamps);
    if (s->n_lamps == 0)
        return;
    glUniform3fv(glGetUniformLocation(program, "lamp_towards"), s->n_lamps, towards[0]);
    glUniform3fv(glGetUniformLocation(program, "lamp_colours"), s->n_lamps, colours[0]);
}
