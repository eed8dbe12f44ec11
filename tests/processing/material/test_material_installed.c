/* libmesorig-material as a user has it: the header, the library and the programs of the
 * documentation are used from an installed prefix. */
#include "lib/material_fixture.h"
#include "lib/process.h"
#include "lib/remove_tree.h"
#include "lib/test.h"

#include <mesorig/material.h>
#include <string.h>

#ifdef __SANITIZE_ADDRESS__
#define SANITIZE "-fsanitize=address,undefined"
#else
#define SANITIZE "-g"
#endif

static char *folder;  /* everything is in it */
static char *library; /* the installed folder of libraries */

/* Runs a line of the shell in the folder, which must succeed; what it prints, g_free(). */
G_GNUC_PRINTF(1, 2)
static char *shell(const char *format, ...) {
    va_list list;
    char *out = NULL, *err = NULL;
    va_start(list, format);
    g_autofree char *line = g_strdup_vprintf(format, list);
    va_end(list);
    const char *const argv[] = {"/bin/sh", "-ec", line, NULL};
    if (process_run_in(folder, argv, &out, &err) != 0)
        g_error("%s:\n%s%s", line, out, err);
    g_free(err);
    return out;
}

/* Installs what has the component material below the folder, and finds its libraries. */
static void install_library(void) {
    folder = g_dir_make_tmp("installed-XXXXXX", NULL);
    g_autofree char *installed = shell("DESTDIR=%s cmake --install %s --component material >log\n"
                                       "find . -name mesorig-material.pc",
                                       folder, BUILD_DIR);
    g_autofree char *pc = g_build_filename(folder, g_strstrip(installed), NULL);
    g_autofree char *pkgconfig = g_path_get_dirname(pc);
    library = g_path_get_dirname(pkgconfig);
    g_setenv("PKG_CONFIG_PATH", pkgconfig, TRUE);
    g_setenv("PKG_CONFIG_SYSROOT_DIR", folder, TRUE);
    g_setenv("LD_LIBRARY_PATH", library, TRUE);
    g_autoptr(BtfMatrix) btf = material_fixture_btf(TRUE);
    g_autofree char *file = g_build_filename(folder, "material.exr", NULL);
    material_fixture_write(file, codecs_find("lpca"), btf, "clusters=2 components=4");
}

/* The blocks of a document that begin with their file's name, as files in the folder. */
static void write_blocks(const char *document, const char *fence, const char *comment) {
    g_autofree char *path = g_build_filename(SOURCE_DIR, "docs", document, NULL);
    g_autofree char *text = NULL;
    g_assert_true(g_file_get_contents(path, &text, NULL, NULL));
    g_auto(GStrv) blocks = g_strsplit(text, fence, -1);
    g_assert_cmpuint(g_strv_length(blocks), >, 1);
    for (gsize k = 1; blocks[k]; k++) {
        g_assert_true(g_str_has_prefix(blocks[k], comment));
        char *end = strstr(blocks[k], "\n```");
        g_assert_nonnull(end);
        end[1] = '\0';
        const char *name = blocks[k] + strlen(comment);
        g_autofree char *file = g_strndup(name, strcspn(name, ":"));
        g_autofree char *to = g_build_filename(folder, file, NULL);
        g_assert_true(g_file_set_contents(to, blocks[k], -1, NULL));
    }
}

/* The header is C89 and C++, and declares what is exported; that is what debian/ has as symbols. */
TEST(interface) {
    g_autofree char *c89 = shell("echo '#include <mesorig/material.h>\nint unused;' >a.c\n"
                                 "cc -std=c89 -pedantic -Wall -Wextra -Werror -c a.c "
                                 "$(pkg-config --cflags mesorig-material)\n"
                                 "cp a.c a.cpp\n"
                                 "c++ -pedantic -Wall -Wextra -Werror -c a.cpp "
                                 "$(pkg-config --cflags mesorig-material)");
    g_autofree char *version = shell("pkg-config --modversion mesorig-material");
    g_assert_cmpstr(g_strstrip(version), ==, MESORIG_VERSION);
    g_autofree char *soname = shell("readelf -d %s/libmesorig-material.so | grep SONAME", library);
    assert_has(soname, "[libmesorig-material.so.0]");
    g_autofree char *exported = shell("nm -D --defined-only --format=posix "
                                      "%s/libmesorig-material.so | sed 's/@@*/ /' | "
                                      "awk '{print $1}' | LC_ALL=C sort",
                                      library);
    g_autofree char *listed = shell("sed -n 's/^ \\([^@]*\\)@.*/\\1/p' "
                                    "%s/debian/libmesorig-material0.symbols | LC_ALL=C sort",
                                    SOURCE_DIR);
    g_assert_cmpstr(exported, ==, listed);
    g_autofree char *declared =
        shell("for name in $(grep -o 'mesorig_material_[a-z_]*(' "
              "%s/processing/material/material.h | tr -d '(' | sort -u); do "
              "echo \"$name;\"; done",
              SOURCE_DIR);
    g_auto(GStrv) names = g_strsplit(g_strstrip(exported), "\n", -1);
    for (gsize k = 0; names[k]; k++) {
        g_autofree char *name = g_strconcat(names[k], ";", NULL);
        if (!g_str_equal(names[k], "MESORIG_MATERIAL_0"))
            assert_has(declared, name);
    }
}

/* The sphere of docs/develop/material.md: lit from the upper left, black around it. */
TEST(program) {
    write_blocks("develop/material.md", "```c\n", "/* ");
    g_autofree char *out = shell("cc " SANITIZE " -Wall -Wextra -Werror -o sphere sphere.c "
                                 "$(pkg-config --cflags --libs mesorig-material) -lm\n"
                                 "./sphere material.exr\n"
                                 "if ./sphere nothing.exr 2>err; then exit 1; fi\n"
                                 "cat err");
    g_auto(GStrv) lines = g_strsplit(out, "\n", -1);
    g_assert_cmpuint(g_strv_length(lines), ==, 26);
    for (int row = 0; row < 24; row++)
        g_assert_cmpuint(strlen(lines[row]), ==, 48);
    g_assert_cmpint(lines[0][0], ==, ' ');
    g_assert_cmpint(lines[12][24], !=, ' ');
    int left = 0, right = 0;
    for (int row = 0; row < 12; row++)
        for (int column = 0; column < 48; column++)
            *(column < 24 ? &left : &right) += lines[row][column] != ' ';
    g_assert_cmpint(left, >, right);
    assert_has(lines[24], "nothing.exr");
}

BEFORE_TESTS {
    install_library();
}

AFTER_TESTS {
    remove_tree(folder);
    g_free(folder);
    g_free(library);
}
