#include "visibility.h"

#include "drawing/gl/gpu.h"

#include <epoxy/gl.h>

#define FACE_BYTES   16
#define HEADER_BYTES 16 /* the buffer of lists begins with the number of faces */

enum form { VIEWS, MAPS, VOLUME, SHELL, N_FORMS };

#define VARIANTS (N_FORMS * PLACES_KINDS) /* number of variants of the programs */

/* The programs of a variant. SURE_BASE does the same as SURE, but does not compute the distance to
 * the structure (base_only in visibility.h). */
enum { BACK, FRONT, SURE, SURE_BASE, ADD, N_PROGRAMS };

struct Visibility {
    /* Programs, by form of the MDF and kind of places. All variants but the first are compiled when
     * they are first needed. SURE, SURE_BASE and ADD exist only with OpenGL 4.3. */
    guint all_programs[VARIANTS][N_PROGRAMS];
    /* programs without variants; they exist only with OpenGL 4.3 */
    guint exits, find;
    guint query; /* whether a layer has back faces */
    /* `back` has the back faces of this layer and those of the previous layer; the two elements
     * change places with each layer. `exit` has the nearest back faces. `seen` is the result of
     * visibility_find(). */
    struct gpu_target back[2], exit, seen;
    /* Stencil buffer of `seen`. With peeling, its value is the layer in which the surface of a
     * pixel was found. With lists, its value is 1 where a pixel has a list. */
    guint stencil;
    /* Each pixel has a list of faces. `faces` is the buffer of all lists (list_nodes.glsl). `first`
     * is a texture with the number of the first face in each pixel's list. */
    guint first, first_framebuffer, faces;
    int first_width, first_height;
    guint32 room; /* number of faces for which the buffer `faces` has space */
};

static gboolean make_programs(guint programs[N_PROGRAMS], enum form form,
                              const struct places_source *places, GError **error) {
    g_autofree char *of_places = places_constants(places, FALSE);
    g_autofree char *constants =
        g_strdup_printf("#define CURVED 0\n#define MDF_MAPS %d\n%s%s%s", form == MAPS,
                        form == VOLUME ? "#define MDF_VOLUME 1\n" : "",
                        form == SHELL ? "#define MDF_SHELL 1\n" : "", of_places);
    const char *names[12] = {"mesh.vert",  "frame.glsl",  "places.glsl", "directions.glsl",
                             "sight.glsl", "curved.glsl", "meets.glsl",  "relief.glsl"};
    int n = 8;
    if (form == SHELL)
        names[n++] = "shell.glsl";
    names[n] = "peel_back.frag";
    if ((programs[BACK] = gpu_program(constants, names, error)) == 0)
        return FALSE;
    names[n] = "peel_front.frag";
    if ((programs[FRONT] = gpu_program(constants, names, error)) == 0)
        return FALSE;
    if (!gpu_has_43())
        return TRUE;
    names[n] = "sure_front.frag";
    g_autofree char *base_only = g_strconcat("#define BASE_ONLY\n", constants, NULL);
    if ((programs[SURE] = gpu_program_43(constants, names, error)) == 0 ||
        (programs[SURE_BASE] = gpu_program_43(base_only, names, error)) == 0)
        return FALSE;
    names[n] = "list_nodes.glsl";
    names[n + 1] = "list_add.frag";
    return (programs[ADD] = gpu_program_43(constants, names, error)) != 0;
}

Visibility *visibility_new(GError **error) {
    g_autoptr(Visibility) v = g_new0(Visibility, 1);
    const struct places_source repeated = {NULL, NULL};
    static const char *const exits[] = {"mesh.vert", "frame.glsl", "sight.glsl", "exits.frag",
                                        NULL};
    static const char *const find[] = {"screen.vert", "meets.glsl", "list_nodes.glsl",
                                       "list_find.frag", NULL};
    if (!make_programs(v->all_programs[0], VIEWS, &repeated, error) ||
        (gpu_has_43() && ((v->exits = gpu_program_43("", exits, error)) == 0 ||
                          (v->find = gpu_program_43("", find, error)) == 0)))
        return NULL;
    glGenQueries(1, &v->query);
    return g_steal_pointer(&v);
}

void visibility_free(Visibility *v) {
    if (v == NULL)
        return;
    for (int k = 0; k < VARIANTS * N_PROGRAMS; k++)
        glDeleteProgram(v->all_programs[k / N_PROGRAMS][k % N_PROGRAMS]);
    glDeleteProgram(v->exits);
    glDeleteProgram(v->find);
    glDeleteQueries(1, &v->query);
    gpu_target_clear(&v->back[0]);
    gpu_target_clear(&v->back[1]);
    gpu_target_clear(&v->exit);
    gpu_target_clear(&v->seen);
    glDeleteTextures(1, &v->stencil);
    glDeleteTextures(1, &v->first);
    glDeleteFramebuffers(1, &v->first_framebuffer);
    glDeleteBuffers(1, &v->faces);
    g_free(v);
}

void visibility_set_sight(guint program, const struct visibility_scene *s) {
    glUniformMatrix4fv(glGetUniformLocation(program, "projection"), 1, GL_FALSE, s->projection);
    glUniform4fv(glGetUniformLocation(program, "sight"), 1, s->sight);
    glUniform1f(glGetUniformLocation(program, "reach"), s->reach);
    glUniform1i(glGetUniformLocation(program, "straight"), s->options.straight);
}

static enum form form_of(const struct visibility_part *part) {
    if (part->volume)
        return VOLUME;
    if (part->shell)
        return SHELL;
    return mdf_texture_is_maps(part->mdf) ? MAPS : VIEWS;
}

static int part_variant(const struct visibility_part *part) {
    return (int)form_of(part) + N_FORMS * (int)places_kind_of(&part->places);
}

/* A drawing pass. textures[0] is bound to VISIBILITY_UNIT, and textures[1] to the next unit.
 * `names` are the names of their samplers. An unused element of `names` is NULL, and an unused
 * element of `textures` is 0. */
struct pass {
    int program; /* BACK, FRONT, SURE, SURE_BASE or ADD */
    const char *names[2];
    guint textures[2];
};

static void draw_elements(const struct visibility_part *part) {
    glDrawElements(GL_TRIANGLES, (GLsizei)part->n_indices, GL_UNSIGNED_INT,
                   (const char *)NULL + sizeof(guint32) * (gsize)part->first_index);
}

static void draw_parts(const Visibility *v, const struct visibility_scene *s,
                       const struct pass *pass) {
    glBindVertexArray(s->array);
    for (int k = 0; k < s->n_parts; k++) {
        const struct visibility_part *part = &s->parts[k];
        const guint program = v->all_programs[part_variant(part)][pass->program];
        glUseProgram(program);
        visibility_set_sight(program, s);
        mdf_texture_bind(part->mdf, program);
        glUniform2fv(glGetUniformLocation(program, "tiles"), 1, part->tiles);
        places_bind(&part->places, part->tiles, program);
        for (int t = 0; t < 2; t++)
            if (pass->names[t] != NULL)
                gpu_bind_texture(program, pass->names[t], VISIBILITY_UNIT + t, GL_TEXTURE_2D,
                                 pass->textures[t]);
        if (pass->program == ADD)
            glUniform1ui(glGetUniformLocation(program, "room"), v->room);
        draw_elements(part);
    }
    glBindVertexArray(0);
}

static void draw_culled(const Visibility *v, const struct visibility_scene *s, GLenum culled,
                        const struct pass *pass) {
    glEnable(GL_CULL_FACE);
    glCullFace(culled);
    draw_parts(v, s, pass);
    glDisable(GL_CULL_FACE);
}

static void clear(guint framebuffer, GLbitfield what) {
    glBindFramebuffer(GL_FRAMEBUFFER, framebuffer);
    glClearColor(0.0f, 0.0f, 0.0f, 0.0f);
    glDepthMask(GL_TRUE);
    glClear(what);
}

/* Draws the back faces of a layer. Returns whether any were drawn, so that there may be more
 * layers. */
static gboolean peel_back(Visibility *v, const struct visibility_scene *s, int layer) {
    GLuint any = 0;
    clear(v->back[layer & 1].framebuffer, GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);
    const struct pass pass = {
        BACK, {"before", "seen"}, {v->back[~layer & 1].colour, v->seen.colour}};
    glBeginQuery(GL_ANY_SAMPLES_PASSED, v->query);
    draw_culled(v, s, GL_FRONT, &pass);
    glEndQuery(GL_ANY_SAMPLES_PASSED);
    glGetQueryObjectuiv(v->query, GL_QUERY_RESULT, &any);
    return any != 0;
}

/* Draws front faces. The stencil buffer stores the layer in which the surface of a pixel was found.
 * Later layers do not draw such a pixel again. */
static void peel_front(Visibility *v, const struct visibility_scene *s, int layer) {
    clear(v->seen.framebuffer, GL_DEPTH_BUFFER_BIT);
    glEnable(GL_STENCIL_TEST);
    glStencilMask(0xff);
    glStencilFunc(GL_LEQUAL, layer, 0xff);
    glStencilOp(GL_KEEP, GL_KEEP, GL_REPLACE);
    const struct pass pass = {
        FRONT, {"before", "back"}, {v->back[~layer & 1].colour, v->back[layer & 1].colour}};
    draw_culled(v, s, GL_BACK, &pass);
    glDisable(GL_STENCIL_TEST);
}

static gboolean peel(Visibility *v, const struct visibility_scene *s, GError **error) {
    for (int k = 0; k < 2; k++)
        if (!gpu_target_resize(&v->back[k], s->width, s->height, GL_RGBA32F, TRUE, error))
            return FALSE;
    glEnable(GL_DEPTH_TEST);
    glDepthFunc(GL_LESS);
    glStencilMask(0xff);
    glClearStencil(0xff);
    clear(v->seen.framebuffer, GL_COLOR_BUFFER_BIT | GL_STENCIL_BUFFER_BIT);
    clear(v->back[1].framebuffer, GL_COLOR_BUFFER_BIT);
    gboolean more = TRUE;
    for (int layer = 0; more && layer < s->options.layers; layer++) {
        more = peel_back(v, s, layer);
        peel_front(v, s, layer);
    }
    return TRUE;
}

/* Allocates the buffer for this number of faces. If the card has not enough memory, deletes the
 * buffer and returns FALSE. */
static gboolean make_room(Visibility *v, guint32 faces) {
    if (v->faces == 0)
        glGenBuffers(1, &v->faces);
    v->room = faces;
    glBindBuffer(GL_SHADER_STORAGE_BUFFER, v->faces);
    glBufferData(GL_SHADER_STORAGE_BUFFER, HEADER_BYTES + FACE_BYTES * (gsize)faces, NULL,
                 GL_DYNAMIC_COPY);
    if (gpu_check("allocating lists of faces", NULL))
        return TRUE;
    glDeleteBuffers(1, &v->faces);
    v->faces = v->room = 0;
    return FALSE;
}

/* Draws the nearest back faces. Then draws the front faces behind which the ray meets the structure
 * for certain. These front faces hide all faces behind them. */
static void find_sure(Visibility *v, const struct visibility_scene *s) {
    glEnable(GL_DEPTH_TEST);
    glDepthFunc(GL_LESS);
    clear(v->exit.framebuffer, GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);
    glUseProgram(v->exits);
    visibility_set_sight(v->exits, s);
    glEnable(GL_CULL_FACE);
    glCullFace(GL_FRONT);
    glBindVertexArray(s->array);
    for (int k = 0; k < s->n_parts; k++)
        draw_elements(&s->parts[k]);
    glBindVertexArray(0);
    glStencilMask(0xff);
    glClearStencil(0);
    clear(v->seen.framebuffer, GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT | GL_STENCIL_BUFFER_BIT);
    draw_culled(
        v, s, GL_BACK,
        &(struct pass){s->base_only ? SURE_BASE : SURE, {"exits", NULL}, {v->exit.colour, 0}});
}

/* Adds all faces that are not hidden by find_sure() to the lists of their pixels. Returns the
 * number of faces. If this number is larger than v->room, the lists are incomplete. */
static guint32 add_faces(Visibility *v, const struct visibility_scene *s) {
    const GLuint none[4] = {0, 0, 0, 0};
    guint32 n_faces = 0;
    glBindFramebuffer(GL_FRAMEBUFFER, v->first_framebuffer);
    glClearBufferuiv(GL_COLOR, 0, none);
    glBindFramebuffer(GL_FRAMEBUFFER, v->seen.framebuffer);
    glColorMask(GL_FALSE, GL_FALSE, GL_FALSE, GL_FALSE);
    glBindBuffer(GL_SHADER_STORAGE_BUFFER, v->faces);
    glBufferSubData(GL_SHADER_STORAGE_BUFFER, 0, sizeof none, none);
    glBindBufferBase(GL_SHADER_STORAGE_BUFFER, 0, v->faces);
    glBindImageTexture(0, v->first, 0, GL_FALSE, 0, GL_READ_WRITE, GL_R32UI);
    glEnable(GL_DEPTH_TEST);
    glDepthMask(GL_FALSE);
    glEnable(GL_STENCIL_TEST);
    glStencilFunc(GL_ALWAYS, 1, 0xff);
    glStencilOp(GL_KEEP, GL_KEEP, GL_REPLACE);
    draw_parts(v, s, &(struct pass){.program = ADD});
    glDisable(GL_STENCIL_TEST);
    glDepthMask(GL_TRUE);
    glDisable(GL_DEPTH_TEST);
    glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
    glMemoryBarrier(GL_SHADER_STORAGE_BARRIER_BIT | GL_SHADER_IMAGE_ACCESS_BARRIER_BIT |
                    GL_BUFFER_UPDATE_BARRIER_BIT | GL_FRAMEBUFFER_BARRIER_BIT);
    glGetBufferSubData(GL_SHADER_STORAGE_BUFFER, 0, sizeof n_faces, &n_faces);
    return n_faces;
}

static gboolean fits(guint32 faces) {
    GLint64 most = 0;
    glGetInteger64v(GL_MAX_SHADER_STORAGE_BLOCK_SIZE, &most);
    return HEADER_BYTES + FACE_BYTES * (gint64)faces <= most;
}

/* Finds the surface by lists. Returns FALSE without an error if the lists do not fit on the card.
 * The caller then peels the faces instead. */
static gboolean list(Visibility *v, const struct visibility_scene *s, GError **error) {
    guint32 start = (guint32)s->width * s->height, n_faces;
    if (v->first == 0 || v->first_width != s->width || v->first_height != s->height) {
        glDeleteTextures(1, &v->first);
        if (v->first_framebuffer == 0)
            glGenFramebuffers(1, &v->first_framebuffer);
        v->first = gpu_texture(GL_R32UI, s->width, s->height, 0);
        v->first_width = s->width;
        v->first_height = s->height;
        glBindFramebuffer(GL_FRAMEBUFFER, v->first_framebuffer);
        glFramebufferTexture2D(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_TEXTURE_2D, v->first, 0);
        if (!gpu_check("making lists of faces", error))
            return FALSE;
    }
    if (!gpu_target_resize(&v->exit, s->width, s->height, GL_R32F, TRUE, error))
        return FALSE;
    find_sure(v, s);
    if (v->room == 0 && (!fits(start) || !make_room(v, start)))
        return FALSE;
    while ((n_faces = add_faces(v, s)) > v->room)
        if (!fits(n_faces + n_faces / 4) || !make_room(v, n_faces + n_faces / 4))
            return FALSE;
    glUseProgram(v->find);
    glUniform1i(glGetUniformLocation(v->find, "layers"), s->options.layers);
    glUniform1i(glGetUniformLocation(v->find, "straight"), s->options.straight);
    glEnable(GL_STENCIL_TEST);
    glStencilFunc(GL_EQUAL, 1, 0xff);
    glStencilOp(GL_KEEP, GL_KEEP, GL_KEEP);
    gpu_fill_screen();
    glDisable(GL_STENCIL_TEST);
    return gpu_check("finding silhouettes in lists", error);
}

/* Compiles the programs of the part's variant if they do not exist yet. */
static gboolean need(Visibility *v, const struct visibility_part *part, GError **error) {
    guint *programs = v->all_programs[part_variant(part)];
    if (programs[BACK] != 0 || make_programs(programs, form_of(part), &part->places, error))
        return TRUE;
    glDeleteProgram(programs[BACK]);
    programs[BACK] = 0;
    return FALSE;
}

gboolean visibility_find(Visibility *v, const struct visibility_scene *s, guint *ret_texture,
                         GError **error) {
    g_autoptr(GError) local = NULL;
    gboolean lists = s->options.way != VISIBILITY_PEEL && gpu_has_43();
    if (s->options.way == VISIBILITY_LISTS && !lists) {
        g_set_error(error, GPU_ERROR, GPU_ERROR_NONE,
                    "silhouettes by lists need OpenGL 4.3, which %s does not offer; leave “=lists” "
                    "out, so that the silhouettes are peeled",
                    gpu_renderer());
        return FALSE;
    }
    for (int k = 0; k < s->n_parts; k++)
        if (!need(v, &s->parts[k], error))
            return FALSE;
    if (v->seen.framebuffer == 0 || v->seen.width != s->width || v->seen.height != s->height) {
        if (!gpu_target_resize(&v->seen, s->width, s->height, GL_RGBA32F, FALSE, error))
            return FALSE;
        glDeleteTextures(1, &v->stencil);
        v->stencil = gpu_texture(GL_DEPTH24_STENCIL8, s->width, s->height, 0);
        glBindFramebuffer(GL_FRAMEBUFFER, v->seen.framebuffer);
        glFramebufferTexture2D(GL_FRAMEBUFFER, GL_DEPTH_STENCIL_ATTACHMENT, GL_TEXTURE_2D,
                               v->stencil, 0);
        if (!gpu_check("allocating silhouettes", error))
            return FALSE;
    }
    glViewport(0, 0, s->width, s->height);
    glDisable(GL_BLEND);
    gboolean found = lists && list(v, s, &local);
    if (local != NULL) {
        g_propagate_error(error, g_steal_pointer(&local));
        return FALSE;
    }
    *ret_texture = v->seen.colour;
    return found || (peel(v, s, error) && gpu_check("peeling silhouettes", error));
}
