/*
 * The programs of a method. What a picture does not need (more lamps than one, their shadows, an
 * even sky, the parts of a material of another size) is not compiled in: not all drivers skip it
 * where it is only switched off. So there are several, each compiled when a picture first asks for
 * it.
 */
#pragma once

#include "viewer.h"

enum program_kind {
    PROGRAM_SURFACE, /* the mesh */
    PROGRAM_RELIEF,  /* with what relief_bind() sets */
    PROGRAM_FLAT,    /* one tile; see viewer_render_flat() */
};

typedef struct Programs Programs; /* belongs to the thread of the GL context */

Programs *programs_new(const struct method *method);
void programs_free(Programs *programs); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Programs, programs_free)

/* Returns 0 on error. Owned by programs. */
guint programs_get(Programs *programs, enum program_kind kind, gconstpointer material,
                   const struct viewer_settings *settings, GError **error);

/* How bright the first lamp is, and all further ones, in a program in use that has further.glsl. */
void programs_set_lamps(guint program, const struct viewer_settings *settings);
