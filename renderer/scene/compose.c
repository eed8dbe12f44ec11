#include "compose.h"

#include "drawing/gl/gpu.h"

#include <epoxy/gl.h>

struct Compose {
    guint program;
    struct gpu_target pictures[2], whole;
};

Compose *compose_new(GError **error) {
    const char *const names[] = {"screen.vert", "compose.frag", NULL};
    g_autoptr(Compose) compose = g_new0(Compose, 1);
    compose->program = gpu_program("", names, error);
    if (compose->program == 0)
        return NULL;
    return g_steal_pointer(&compose);
}

void compose_free(Compose *compose) {
    if (compose == NULL)
        return;
    glDeleteProgram(compose->program);
    for (int k = 0; k < 2; k++)
        gpu_target_clear(&compose->pictures[k]);
    gpu_target_clear(&compose->whole);
    g_free(compose);
}

gboolean compose_draw(Compose *compose, Viewer *first, Viewer *second, const struct compose *how,
                      const struct viewer_settings *settings, guint framebuffer, int width,
                      int height, GError **error) {
    Viewer *const viewers[2] = {first, second};
    const guint program = compose->program;
    if (how->mode == COMPOSE_ONE)
        return viewer_draw(first, settings, framebuffer, width, height, error);
    for (int k = 0; k < 2; k++)
        if (!gpu_target_resize(&compose->pictures[k], width, height, GL_RGBA8, FALSE, error) ||
            !viewer_draw(viewers[k], settings, compose->pictures[k].framebuffer, width, height,
                         error))
            return FALSE;
    glBindFramebuffer(GL_FRAMEBUFFER, framebuffer);
    glViewport(0, 0, width, height);
    glDisable(GL_DEPTH_TEST);
    glDisable(GL_BLEND);
    glUseProgram(program);
    gpu_bind_texture(program, "first", 0, GL_TEXTURE_2D, compose->pictures[0].colour);
    gpu_bind_texture(program, "second", 1, GL_TEXTURE_2D, compose->pictures[1].colour);
    glUniform1i(glGetUniformLocation(program, "difference"), how->mode == COMPOSE_DIFFERENCE);
    glUniform1f(glGetUniformLocation(program, "split"), (float)(how->at * width));
    glUniform1f(glGetUniformLocation(program, "gain"), (float)how->gain);
    gpu_fill_screen();
    return gpu_check("joining two pictures", error);
}

guint8 *compose_render(Compose *compose, Viewer *first, Viewer *second, const struct compose *how,
                       const struct viewer_settings *settings, int width, int height,
                       GError **error) {
    if (!gpu_target_resize(&compose->whole, width, height, GL_RGBA8, FALSE, error) ||
        !compose_draw(compose, first, second, how, settings, compose->whole.framebuffer, width,
                      height, error))
        return NULL;
    return gpu_target_read(&compose->whole, error);
}
