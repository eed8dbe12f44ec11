/* An OpenGL context for a test that draws. Without OpenGL, the test is skipped. */
#pragma once

#include "drawing/gl/gpu.h"
#include "skip.h"
#include "test.h"

/* TEST() of test.h with a separate context. */
#define GPU_TEST(name)                                                                             \
    static void gpu_##name(void);                                                                  \
    TEST(name) {                                                                                   \
        gpu_fixture_run(gpu_##name);                                                               \
    }                                                                                              \
    static void gpu_##name(void)

void gpu_fixture_run(void (*run)(void)); /* called by the macro */

/* Adds a test that runs with a separate context. data is passed to run. */
void gpu_fixture_add(const char *path, void (*run)(gconstpointer data), gconstpointer data);
