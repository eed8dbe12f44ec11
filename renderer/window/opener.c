#include "opener.h"

#include "drawing/gl/gpu.h"
#include "drawing/methods/methods.h"
#include "exr/exr.h"

#include <epoxy/gl.h>
#include <gio/gio.h>
#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>

#define PUT 1000 /* share of a job, in thousandths, that is done when its file has been read */

struct Opener {
    GLFWwindow *context; /* hidden window with the second GL context */
    GThreadPool *thread;
    GAsyncQueue *finished; /* of struct opened */
    /* atomic: number of the job that is wanted for each place; 0 if there is none */
    gint wanted[OPENER_PLACES];
    gint asked; /* number of the latest request */
    /* number of requested jobs that opener_poll() has not returned yet */
    int under_way;
    gint share; /* atomic: share of the running job that is done, in thousandths */
    /* atomic: the running job, or NULL; it exists until opener_poll() returns it */
    const struct opened *working;
};

static gboolean is_wanted(const Opener *opener, const struct opened *o) {
    return g_atomic_int_get(&opener->wanted[o->place]) == o->number;
}

static gboolean note_share(double share, gpointer data) {
    Opener *opener = data;
    g_atomic_int_set(&opener->share, (gint)(share * PUT));
    return is_wanted(opener, opener->working);
}

static void work(gpointer data, gpointer user_data) {
    struct opened *o = data;
    Opener *opener = user_data;
    g_atomic_int_set(&opener->share, 0);
    g_atomic_pointer_set(&opener->working, o);
    exr_watch(note_share, opener);
    if (is_wanted(opener, o) && o->place == OPENER_MDF) {
        o->mdf = mdf_source_read(o->path, &o->error);
    } else if (is_wanted(opener, o) && o->place == OPENER_ENVIRONMENT) {
        o->environment = environment_open(o->path, &o->error);
    } else if (is_wanted(opener, o)) {
        glfwMakeContextCurrent(opener->context);
        gpu_watch();
        o->material = method_open(o->method, o->path, &o->error);
        glFinish(); /* the window's context may read the new objects only after this */
        glfwMakeContextCurrent(NULL);
    }
    exr_watch(NULL, NULL);
    g_atomic_pointer_set(&opener->working, NULL);
    g_async_queue_push(opener->finished, o);
    glfwPostEmptyEvent();
}

/* GLFW makes a context together with a window. This window is never shown. */
Opener *opener_new(struct GLFWwindow *window, GError **error) {
    glfwWindowHint(GLFW_VISIBLE, GLFW_FALSE);
    GLFWwindow *context = glfwCreateWindow(16, 16, "mesorig-view", NULL, window);
    glfwWindowHint(GLFW_VISIBLE, GLFW_TRUE);
    if (context == NULL) {
        g_set_error(error, GPU_ERROR, GPU_ERROR_NONE,
                    "no second OpenGL context for loading materials can be made; draw without a "
                    "window: --render FILE.png");
        return NULL;
    }
    Opener *opener = g_new0(Opener, 1);
    opener->context = context;
    opener->finished = g_async_queue_new();
    opener->thread = g_thread_pool_new(work, opener, 1, FALSE, NULL);
    return opener;
}

void opened_free(struct opened *opened) {
    if (opened == NULL)
        return;
    if (opened->material != NULL)
        opened->method->free(opened->material);
    mdf_source_free(opened->mdf);
    environment_free(opened->environment);
    g_clear_error(&opened->error);
    g_free(opened->path);
    g_free(opened);
}

/* The running job ends at its next read. Waiting jobs end immediately. */
void opener_free(Opener *opener) {
    if (opener == NULL)
        return;
    for (int k = 0; k < OPENER_PLACES; k++)
        g_atomic_int_set(&opener->wanted[k], 0);
    g_thread_pool_free(opener->thread, FALSE, TRUE);
    for (struct opened *o; (o = opener_poll(opener)) != NULL;)
        opened_free(o);
    g_async_queue_unref(opener->finished);
    glfwDestroyWindow(opener->context);
    g_free(opener);
}

void opener_ask(Opener *opener, enum opener_place place, const struct method *method,
                const char *path) {
    struct opened *o = g_new(struct opened, 1);
    *o = (struct opened){
        .place = place, .method = method, .path = g_strdup(path), .number = ++opener->asked};
    g_atomic_int_set(&opener->wanted[place], o->number);
    opener->under_way++;
    g_thread_pool_push(opener->thread, o, NULL);
}

void opener_cancel(Opener *opener, enum opener_place place) {
    g_atomic_int_set(&opener->wanted[place], 0);
}

struct opened *opener_poll(Opener *opener) {
    for (struct opened *o; (o = g_async_queue_try_pop(opener->finished)) != NULL;) {
        opener->under_way--;
        if (is_wanted(opener, o)) {
            g_atomic_int_set(&opener->wanted[o->place], 0);
            return o;
        }
        opened_free(o);
    }
    return NULL;
}

gboolean opener_is_busy(const Opener *opener) {
    return opener->under_way > 0;
}

char *opener_progress(const Opener *opener) {
    const struct opened *working = g_atomic_pointer_get(&((Opener *)opener)->working);
    const int share = g_atomic_int_get(&opener->share);
    if (working == NULL)
        return opener_is_busy(opener) ? g_strdup("opening …") : NULL;
    g_autofree char *name = g_path_get_basename(working->path);
    return share < PUT ? g_strdup_printf("opening %s: %d %%", name, share / (PUT / 100))
                       : g_strdup_printf("uploading %s to the card", name);
}
