/* A table of kernels in C, for trials of the marshaller with a compiler's checks: each reads all that
   its arguments claim to be, so that a wrong argument that gets through is a fault of memory. */
#include <string.h>

#include "entries.h"

void *NRT_MemInfo_alloc_aligned(size_t size, unsigned align);

/* Sum of an array of two dimensions; `given` is where its seven or more numbers begin. */
static double sum_of(const int64_t *given, size_t size) {
    const char *data = (const char *)(intptr_t)given[4];
    double sum = 0, wide;
    float small;
    for (int64_t row = 0; row < given[5]; row++)
        for (int64_t column = 0; column < given[6]; column++) {
            const char *at = data + row * given[7] + column * given[8];
            if (size == 8) memcpy(&wide, at, 8);
            else memcpy(&small, at, 4);
            sum += size == 8 ? wide : small;
        }
    return sum;
}

static int singles(const int64_t *given, int64_t *result) {
    const double sum = sum_of(given, 4);
    memcpy(result, &sum, 8);
    return 0;
}

static int pair(const int64_t *given, int64_t *result) { /* a bundle of two arrays, and a factor */
    double factor, sum = sum_of(given, 4) + sum_of(given + 9, 8);
    memcpy(&factor, given + 18, 8);
    sum *= factor;
    memcpy(result, &sum, 8);
    return 0;
}

static int four(const int64_t *given, int64_t *result) {
    memcpy(result, given, 4 * sizeof *result);
    return 0;
}

static int made(const int64_t *given, int64_t *result) { /* numbers from 0 on */
    const int64_t count = given[0];
    if (count < 0 || count > 1 << 20) return 3;
    char *memory = NRT_MemInfo_alloc_aligned((size_t)count * 8, 32);
    if (!memory) return -1;
    double *data;
    memcpy(&data, memory + 24, sizeof data); /* its place in numba's MemInfo */
    for (int64_t n = 0; n < count; n++) data[n] = (double)n;
    const int64_t array[] = {(int64_t)(intptr_t)memory, 0, count, 8, (int64_t)(intptr_t)data, count, 8};
    memcpy(result, array, sizeof array);
    return 0;
}

static int nothing(const int64_t *given, int64_t *result) {
    (void)given;
    (void)result;
    return -2;
}

#define NAME "tests.faults.kernels."
#define PAIR "(tests.small_kernels.Pair;[f4,2,C][f8,2,A])"
const Entry ENTRIES[] = {
    {NAME "four", "qdbn", "s", "T4:;qdbq", 4, four, 0},
    {NAME "four", "su1sf4sb1q", "s", "T4:;qqqq", 4, four, 0},
    {NAME "made", "q", "s", "Af8,1;", 1, made, 0},
    {NAME "pair", PAIR "d", "s", "d", 19, pair, 0},
    {NAME "singles", "[f4,2,A]", "s", "d", 9, singles, 0},
    {NAME "singles", "[f4,2,C]", "s", "d", 9, singles, 0},
    {NAME "singles", "[f4,2,Cr]", "s", "d", 9, singles, 0},
    {NAME "singles", "[f4,2,F]", "s", "d", 9, singles, 0},
    {NAME "singles", "n", "s", "n", 1, nothing, 0},
    {0}};
const int ENTRY_COUNT = 9;
const Failure FAILURES[] = {{0}};
const int FAILURE_COUNT = 0;
