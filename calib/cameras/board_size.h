/*
 * Notices a wrong size of the board while pictures are searched for it. The commonest mistake in a
 * board's description is its size: corners are counted where squares are meant, or one is counted
 * too many. A search for a board that is not there takes minutes, and its failure does not say why.
 *
 * A few of the pictures are therefore searched for a board of the given print and any size. A
 * picture counts only if it shows the white margin along all four sides of the board that is found,
 * because a board that is partly covered, or partly outside of the picture, would pass for a
 * smaller one. If two pictures (three of a grid of markers or circles) show the same other size,
 * and none the given one, the search ends with an error that names the size.
 *
 * Columns and rows of chessboards and of symmetric grids of circles look the same if they are
 * exchanged, and are not compared. Boards of less than 4 × 4 squares or 3 × 3 circles are not
 * recognised, nor boards without a margin; then nothing is said. Only a chessboard with just as
 * many inner corners as the given one has squares is recognised without a margin.
 *
 * Any thread; several threads may use one census together.
 */
#pragma once

#include "board_find.h"

struct board_census;

struct board_census *board_census_new(const struct board *given);
void board_census_free(struct board_census *census); /* NULL is ignored */
typedef struct board_census BoardCensus;
G_DEFINE_AUTOPTR_CLEANUP_FUNC(BoardCensus, board_census_free)

/* Examines a picture before the search, if it is so large that a vain search takes seconds. FALSE:
 * BOARD_ERROR_SPEC, the pictures show another size, which the error names. ret_more: pictures of
 * this size should be examined further. A picture costs no time once one has shown the given size.
 */
gboolean board_census_before(struct board_census *census, const struct picture *picture,
                             gboolean *ret_more, GError **error);

/* Examines a picture in which board_find() has found nothing (NULL), or corners of a board that
 * goes on beyond them. FALSE as before. */
gboolean board_census_after(struct board_census *census, const struct picture *picture,
                            const GArray *corners, GError **error);

/* For tests, which count how often a single picture gives the right size. The size of the board in
 * a picture: columns and rows of the given print, in the order of the given ones where they look
 * the same exchanged. FALSE: it is not known, or the board does not end within the picture. */
gboolean board_measure(const struct picture *picture, const struct board *given, int *ret_columns,
                       int *ret_rows);
