/*
 * Tests that register themselves:
 *
 *     TEST(round_trip) {
 *         …
 *     }
 *
 * In test_exr.c this is the test /exr/round-trip; a double underscore in the name becomes a slash.
 * Tests run in the order in which they stand in the file. main() is in this library. A program that
 * needs its arguments has its own main(), which ends with tests_run().
 */
#pragma once

#include <glib.h>

#define TEST(name)                                                                                 \
    static void test_##name(void);                                                                 \
    __attribute__((constructor)) static void add_##name(void) {                                    \
        tests_register(__FILE__, #name, test_##name);                                              \
    }                                                                                              \
    static void test_##name(void)

/* Runs once, after g_test_init() and before the first test: it may add further tests. */
#define BEFORE_TESTS TESTS_HOOK_(before, tests_set_before)

/* Runs once, after the last test. */
#define AFTER_TESTS TESTS_HOOK_(after, tests_set_after)

/* Sets the function that tests_run() calls instead of g_test_run(), such as a function of a
 * fixture. It must call g_test_run() and return the result. */
#define TESTS_RUN_BY(runner)                                                                       \
    __attribute__((constructor)) static void set_runner(void) {                                    \
        tests_set_runner(runner);                                                                  \
    }                                                                                              \
    G_STATIC_ASSERT(TRUE) /* for the semicolon */

/* Initializes GLib's tests, runs all tests of this program, and returns the exit code for
 * main(). */
int tests_run(int argc, char **argv);

/* Called by the macros. */
void tests_register(const char *file, const char *name, void (*run)(void));
void tests_set_before(void (*run)(void));
void tests_set_after(void (*run)(void));
void tests_set_runner(int (*run)(void));

#define TESTS_HOOK_(when, set)                                                                     \
    static void when##_tests(void);                                                                \
    __attribute__((constructor)) static void set_##when##_tests(void) {                            \
        set(when##_tests);                                                                         \
    }                                                                                              \
    static void when##_tests(void)
