/* Shader programs that a bench puts together itself, from its own texts and embedded ones. */
#pragma once

#include "drawing/gl/shaders.h"

#include <epoxy/gl.h>
#include <glib.h>
#include <string.h>

/* An embedded shader of renderer/shaders. */
static inline const char *bench_text_of(const char *name) {
    for (int k = 0; shaders[k].name != NULL; k++)
        if (strcmp(shaders[k].name, name) == 0)
            return shaders[k].source;
    g_error("no shader “%s” was compiled in", name);
}

static inline GLuint bench_compile(GLenum kind, const char *const *texts) {
    const GLuint shader = glCreateShader(kind);
    GLint good = 0;
    glShaderSource(shader, (int)g_strv_length((char **)texts), texts, NULL);
    glCompileShader(shader);
    glGetShaderiv(shader, GL_COMPILE_STATUS, &good);
    if (!good) {
        char log[2000] = "";
        glGetShaderInfoLog(shader, sizeof log, NULL, log);
        g_error("a shader of this program does not compile: %s", log);
    }
    return shader;
}

/* Texts of both shaders, NULL-ended; what does not compile or link ends the program. */
static inline GLuint bench_program(const char *const *vertex, const char *const *fragment) {
    const GLuint program = glCreateProgram();
    const GLuint parts[] = {bench_compile(GL_VERTEX_SHADER, vertex),
                            bench_compile(GL_FRAGMENT_SHADER, fragment)};
    GLint good = 0;
    for (int k = 0; k < 2; k++) {
        glAttachShader(program, parts[k]);
        glDeleteShader(parts[k]);
    }
    glLinkProgram(program);
    glGetProgramiv(program, GL_LINK_STATUS, &good);
    if (!good)
        g_error("a program of this bench does not link");
    return program;
}
