#include "programs.h"

#include "gpu.h"

#include <epoxy/gl.h>

#define OTHERS 8 /* shaders that are not the method's */

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

static void add(const char **names, const char *const *more) {
    while (*names != NULL)
        names++;
    for (int k = 0; more[k] != NULL; k++)
        *names++ = more[k];
    *names = NULL;
}

static guint compile(const struct method *method, enum program_kind kind, const char *constants,
                     GError **error) {
    static const char *const before[] = {"mesh.vert", "frame.glsl", NULL};
    static const char *const before_flat[] = {"screen.vert", "flat.glsl", NULL};
    static const char *const after[][5] = {
        {"lamps.glsl", "surface.frag", NULL},
        {"lamps.glsl", "visible.glsl", "shadow.glsl", "surface_relief.frag", NULL},
        {"flat.frag", NULL},
    };
    const char *names[METHOD_SHADERS + OTHERS] = {NULL};
    add(names, kind == PROGRAM_FLAT ? before_flat : before);
    add(names, method->shaders);
    add(names, after[kind]);
    return gpu_program_with(constants, names, error);
}

guint programs_get(Programs *programs, enum program_kind kind, gconstpointer material,
                   const struct view_settings *s, GError **error) {
    const struct method *method = programs->method;
    g_autofree char *own = method->constants ? method->constants(material, &s->style) : NULL;
    g_autofree char *constants = g_strdup_printf("#define LAMPS %d\n#define AMBIENT %d\n%s",
                                                 s->n_lamps > 0, s->ambient > 0, own ? own : "");
    char *key = g_strdup_printf("%d %s", kind, constants);
    guint program = GPOINTER_TO_UINT(g_hash_table_lookup(programs->compiled, key));
    if (program == 0 && (program = compile(method, kind, constants, error)) != 0)
        g_hash_table_insert(programs->compiled, g_steal_pointer(&key), GUINT_TO_POINTER(program));
    g_free(key);
    return program;
}
