/* Damaged EXR files, and readers that must refuse them. read is a function of a path and a GError
 * that returns a pointer. */
#pragma once

#include "exr/exr.h"

#include <glib.h>
#include <string.h>

/* Writes the file to path and frees it. The error must be EXR_ERROR_FORMAT. */
#define assert_file_refused(read, path, file)                                                      \
    do {                                                                                           \
        g_autoptr(GError) file_error_ = NULL;                                                      \
        g_assert_true(exr_write(path, file, EXR_ZIP, FALSE, &file_error_));                        \
        exr_file_free(file);                                                                       \
        g_assert_null(read(path, &file_error_));                                                   \
        g_assert_error(file_error_, EXR_ERROR, EXR_ERROR_FORMAT);                                  \
        g_assert_nonnull(strstr(file_error_->message, path));                                      \
    } while (0)

/* Cuts the file short at every step-th byte. */
#define assert_cut_refused(read, path, step)                                                       \
    do {                                                                                           \
        g_autofree char *bytes_ = NULL;                                                            \
        gsize length_;                                                                             \
        g_assert_true(g_file_get_contents(path, &bytes_, &length_, NULL));                         \
        for (gsize cut_ = 0; cut_ < length_; cut_ += (step)) {                                     \
            g_autoptr(GError) cut_error_ = NULL;                                                   \
            g_assert_true(g_file_set_contents(path, bytes_, (gssize)cut_, NULL));                  \
            g_assert_null(read(path, &cut_error_));                                                \
            g_assert_nonnull(cut_error_);                                                          \
        }                                                                                          \
    } while (0)
