"""Constants of the first stage of the diagnosis, each with its unit and the reason for its value."""

from __future__ import annotations

from dataclasses import dataclass

from gsid.response.sample_hold import LARGEST_SIZE, LEAST_POWER


@dataclass(frozen=True)
class SearchSettings:
    """Constants of `gsid.diagnosis.missing_torque`.

    Attributes
    ----------
    images : int
        Images of the held command on each side of a line that are evaluated at the lines. Further ones are
        smooth in frequency.
    images_far : int
        Last image on each side. Their sum falls as 1/m; without the images beyond the third a lag of 0.025
        samples did not show. Those beyond this one are 2e-4 of the response of a body at 0.15 of the sample
        rate.
    images_least : float
        Least power of the images of a sensor that is sampled and held, over that of noise, summed over the
        records. In 92 development trials it is 31 000 and more with such a sensor, and below 30 without one
        or play.
    images_size : float
        Largest ratio of the images' size to that of a sensor of that rate: play has other sizes.
    hold_ratio : float
        Ratio of the linear part's costs with both readings of an unknown hold up to which both are tried, if
        even the better one is not good. On the hysteretic benchmark the wrong one is 10 % better.
    hold_lag : float
        Lag [samples] that the readings of an unknown hold are compared with as well: a missing lag attenuates
        as a hold does.
    motion_band : float
        Highest line of the motion, in highest lines of the fit. Friction moves the axis above the excitation;
        far above it the output is noise.
    oversampling : float
        Samples of the motion per period of its highest line. A torque that jumps has harmonics above it; at 6
        they fold back below the noise of the trials.
    delays : tuple of float
        Starts of the delay, in given delays. A wrong delay is a local minimum at half a period of the highest
        line.
    missing_delays : tuple of float
        Values of a delay that the model lacks, in samples: the fit finds the rest.
    corners : tuple of float
        Corner frequencies at which a spring or a damping that the model lacks is tried, in lowest lines of
        the fit: far below that line they do not show.
    held_angle : float
        Resonance of the axis with its spring, in lowest lines, above which the spring holds the mean angle:
        it changes the response at the lowest line by a quarter, which all records show.
    mode_points : int
        Frequencies at which a mode of the model is searched, where the fit from the given values fails.
    mode_lowest : float
        Lowest frequency of a mode that the model lacks, in lowest lines of the fit, where that is below the
        grid of the effect: a lower one is a spring, or what a law does.
    mode_dampings : tuple of float
        Its damping ratios there.
    mode_spread : float
        Farthest frequency, as a share of the given one.
    mode_gain : float
        Share of the cost by which another place of a mode lowers it: less is the end of a fit.
    good_cost : float
        Cost per degree of freedom above which the fit of the linear part is tried from other starts too.
    steps : int
        Largest number of evaluations of a fit: five are usual; a fit that needs more than 30 is in a wrong
        minimum.
    tolerance : float
        Relative change of the cost that ends a fit; a tenth of a unit in a cost of 1e4 does not matter.
    refined_share : float
        Laws that explain less than this share of the best law's gain keep the shape of the grid: a shape
        between two grid points adds less than that.
    shape_steps : int
        Evaluations of a shape between its neighbours in the grid. Each golden section step leaves 0.62: 10
        leave a hundredth of the distance.
    n_refitted : int
        Laws that are refitted jointly with the linear part. With the best of each family the right law of the
        development trials was always among them.
    family_share : float
        The best of each family is refitted as well if it explains this share of the cost.
    passes : int
        Joint fits with the motion and the shape taken again: the second changes the cost by some percent, a
        third by less than noise.
    stuck : float
        Rate below which an axis with dry friction may stick, in standard deviations of its measured rate; its
        sign is noise there.
    model_error : float
        Kept-out cost of the best law above which the weights contain what it leaves: the model's error is
        then larger than noise.
    renewed : float
        Difference of the best law's cost per degree of freedom from 1 up to which these weights are not
        renewed again: no decision depends on so little.
    dissipated_least : float
        Least share of the work of a law with memory that does not come back. A loop that is nearly closed is
        a spring: on a measured cubic spring 0.6 %, on the hysteretic benchmark 40 %.
    cancelled : float
        Least sum of a law's own stiffness and that of the linear part, as a share of the latter. Where they
        cancel, the measured motion explains itself: on the hysteretic benchmark an unbalance of 5e10
        left a thousandth of the power of noise.
    named_lead : float
        Drop of the cost against the best other family that is as good as the margin, where the law leaves
        only noise: a weak effect has no large ratio. What a wrong law of a weak effect leaves is hidden in
        the scatter of the cost, some 80 in 3000 numbers.
    named_share, named_margin, named_scatter : float
        Least share kept out, least margin over the best other family, and largest scatter of the coefficient
        for a name. With lower limits the development trials have wrong names (`make first-stage-study`).
    exact_share : float
        Least share of a law whose column does not depend on the measured motion: a mode that stands in for a
        lag explains 96 to 99 %.
    scatter_errors : float
        A scatter within this many standard errors is noise.
    nearest_share, nearest_scatter : float
        Least share and largest scatter of a nearest law: one that explains less than half is not the main
        effect.
    enlarged_gain : float
        Drop of the cost by which an enlarged law, a rival from outside the catalogue, must not beat a name.
    free_functions : int
        Splines of a free function over the travel, the rates or the commands: rivals from outside the
        catalogue with a width of a tenth of the range.
    free_share, free_share_of_error : float
        Share of what a law leaves above noise that a free function of its coordinate must not explain; the
        second where a model error is left, which resembles such functions (measured records: up to 0.6).
    free_least : float
        Share of the misfit without the law that a free function has to explain to be a rival: errors of the
        measured motion, which grow with the law, reach 0.8 % beside true cogging.
    free_price, free_clear_price : float
        Least drop of the cost for a free function, in ln n for each of its numbers. In the blind trials it is
        0.5 at most beside true laws, and 4.5 beside a magnet that snaps. Above the second, any share of the
        misfit is enough: beside true cogging in little noise it reaches 3.9.
    member_gain : float
        Drop of the cost that a law with more parameters needs against a simpler one of its family.
    member_share : float
        The same as a share of what the laws explain: errors of the measured motion are of that size.
    member_cost : float
        Kept-out cost above which only the family is certain.
    null_gain : float
        Drop of the cost that any law needs beside ln n per parameter: the best of some 200 columns reaches 10
        by chance in one of 20 nulls.
    null_cost : float
        Cost per degree of freedom up to which nothing may be missing.
    verdict_cost : float
        Kept-out cost above which no law is named: the linear part itself is wrong there.
    unconverged : float
        Kept-out cost over the cost per number below which a fit has not converged: the linearised fits to all
        but one realisation predict that one better than it was fitted.
    periods_least : int
        Fewest periods of a single record for a name: its thirds have two periods each.
    """

    images: int = 3
    images_far: int = 250
    images_least: float = LEAST_POWER
    images_size: float = LARGEST_SIZE
    hold_ratio: float = 4.0
    hold_lag: float = 0.3
    motion_band: float = 2.0
    oversampling: float = 6.0
    delays: tuple[float, ...] = (0.5, 0.75, 1.0, 1.35, 1.8)
    missing_delays: tuple[float, ...] = (1.0, 3.0, 8.0, 16.0)
    corners: tuple[float, ...] = (0.3, 0.7, 1.5, 3.0, 6.0, 12.0)
    held_angle: float = 0.5
    mode_points: int = 260
    mode_lowest: float = 4.0
    mode_dampings: tuple[float, ...] = (0.005, 0.02, 0.08)
    mode_spread: float = 1.6
    mode_gain: float = 1e-3
    good_cost: float = 1.5
    steps: int = 30
    tolerance: float = 1e-5
    refined_share: float = 0.2
    shape_steps: int = 10
    n_refitted: int = 5
    family_share: float = 0.02
    passes: int = 2
    stuck: float = 4.0
    named_share: float = 0.9
    named_margin: float = 6.0
    named_scatter: float = 0.06
    model_error: float = 3.0
    renewed: float = 0.1
    dissipated_least: float = 0.1
    cancelled: float = 0.1
    named_lead: float = 100.0
    exact_share: float = 0.995
    scatter_errors: float = 2.5
    nearest_share: float = 0.5
    nearest_scatter: float = 0.3
    enlarged_gain: float = 6.0
    free_functions: int = 12
    free_share: float = 0.25
    free_share_of_error: float = 0.9
    free_least: float = 0.01
    free_price: float = 1.5
    free_clear_price: float = 6.0
    member_gain: float = 12.0
    member_share: float = 0.002
    member_cost: float = 1.3
    null_gain: float = 10.0
    null_cost: float = 1.1
    verdict_cost: float = 100.0
    unconverged: float = 0.7
    periods_least: int = 6


DEFAULTS = SearchSettings()
