/*
 * The ways to draw a material. Each compression of a BTF is read from a file of its own, held on
 * the card in its own way and evaluated by its own piece of shader; all else about a picture is the
 * same for all of them.
 */
#pragma once

#include <glib.h>

#define METHOD_UNITS 8 /* texture units 0 … 7 are a method's, higher ones the view's */

struct method {
    const char *name;    /* of --method */
    const char *title;   /* for people */
    const char *product; /* its file in products/ of a session, and */
    const char *made_by; /* the command that makes it */
    /* GLSL files, at most 4, NULL-ended. They define
     *   vec3 btf(vec2 x, vec3 v, vec3 l, float lit)
     * at texel coordinates x (in tiles, y along the texture's rows downwards), for unit vectors
     * in its frame (+y upwards): lit × the reflectance under the light l, plus uniform float
     * ambient × that under an even sky. lit is 0 in a shadow, else 1. */
    const char *const *shaders;
    /* The following belong to the thread of the GL context. open reads a file and puts it on the
     * card. */
    gpointer (*open)(const char *path, GError **error);
    void (*free)(gpointer material);
    /* Sets textures and uniforms of a program in use that has the shaders. nearest: no filtering
     * between texels. */
    void (*bind)(gpointer material, guint program, gboolean nearest);
};

extern const struct method *const methods[]; /* NULL-ended; the first is the default */

const struct method *method_find(const char *name); /* NULL: there is none */

/* argument: a file, or a session's directory, in which the method's product is meant. g_free() */
char *method_path(const struct method *method, const char *argument);

/* As open, with a sentence if the file is not there. */
gpointer method_open(const struct method *method, const char *path, GError **error);
