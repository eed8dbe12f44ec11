/*
 * The shader programs of a method. A feature that a picture does not use (further lamps, shadows of
 * further lamps, an even sky) is left out at compile time, because some drivers do not skip a
 * branch that a uniform switches off. Each variant is compiled when a picture first needs it.
 */
#pragma once

#include "drawing/gl/places.h"
#include "viewer_settings.h"

enum program_kind {
    PROGRAM_SURFACE, /* the mesh */
    PROGRAM_RELIEF,  /* the mesh with relief; needs the uniforms of relief_bind() */
    PROGRAM_FLAT,    /* one tile; see viewer_render_flat() */
};

typedef struct Programs Programs; /* belongs to the thread of the GL context */

Programs *programs_new(const struct method *method);
void programs_free(Programs *programs); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Programs, programs_free)

/* Returns the program for a picture with these settings, and compiles it if necessary. The Programs
 * own the program. material is a material of the method. places says which places of the sample the
 * surface shows (places.h). Returns 0 with an error if the program cannot be compiled. */
guint programs_get(Programs *programs, enum program_kind kind, gconstpointer material,
                   const struct places_source *places, const struct viewer_settings *settings,
                   GError **error);

/* Sets the brightness of the first lamp and all further lamps in a program in use that has
 * further.glsl. radius is the radius of the mesh. */
void programs_set_lamps(guint program, const struct viewer_settings *settings, double radius);
