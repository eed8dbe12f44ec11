#include "fuzz.h"

#include "base/input_file.h"
#include "lib/remove_tree.h"

#include <fcntl.h>
#include <glib/gstdio.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

static void fill(int fd, const uint8_t *data, size_t size) {
    g_assert_cmpint(ftruncate(fd, 0), ==, 0);
    g_assert_cmpint(pwrite(fd, data, size, 0), ==, (gssize)size);
}

const char *fuzz_file(const uint8_t *data, size_t size) {
    static char path[64];
    static int fd = -1;
    if (fd < 0) {
        fd = memfd_create("fuzz", MFD_CLOEXEC);
        g_snprintf(path, sizeof path, "/proc/self/fd/%d", fd);
    }
    fill(fd, data, size);
    return path;
}

static char *folder;

static void remove_folder(void) {
    remove_tree(folder);
}

const char *fuzz_file_in_folder(const char *name, const uint8_t *data, size_t size) {
    static char *path;
    if (!folder) {
        folder = g_strdup("/dev/shm/mesorig-fuzz-XXXXXX");
        g_assert_nonnull(g_mkdtemp(folder));
        atexit(remove_folder);
    }
    g_free(path);
    path = g_build_filename(folder, name, NULL);
    const int fd = open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    if (fd < 0) /* a name that no file can have */
        return NULL;
    fill(fd, data, size);
    close(fd);
    return path;
}

/* The linker puts this before the program's own. */
gboolean __real_input_file_check_pixels(const char *path, guint64 width, guint64 height,
                                        guint64 file_bytes, GError **error);
gboolean __wrap_input_file_check_pixels(const char *path, guint64 width, guint64 height,
                                        guint64 file_bytes, GError **error);
gboolean __wrap_input_file_check_pixels(const char *path, guint64 width, guint64 height,
                                        guint64 file_bytes, GError **error) {
    if (!__real_input_file_check_pixels(path, width, height, file_bytes, error))
        return FALSE;
    if (width * height <= FUZZ_MAX_PIXELS)
        return TRUE;
    g_set_error(error, INPUT_FILE_ERROR, INPUT_FILE_ERROR_TOO_LARGE, "%s: too large to fuzz", path);
    return FALSE;
}

char *fuzz_text(const uint8_t *data, size_t size) {
    return g_strndup((const char *)data, size);
}

void fuzz_check(gboolean ok, GError **error) {
    g_assert_true(ok == (*error == NULL));
    g_clear_error(error);
}
