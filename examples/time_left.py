"""An observation with the time that is left: how long the energy lasts in the air, and the clock.

python -m uav_collect train --override observation=time_left:TimeLeft
"""


class TimeLeft:
    base = 'egocentric'  # its numbers come first
    size = 2

    def numbers(self, situation):
        briefing, uav, view = situation.briefing, situation.uav, situation.view
        usable_j = view.energy_left_j - briefing.energy_margin_j[uav]
        left_s = usable_j / max(briefing.flight_power_w[uav], briefing.hover_power_w[uav])
        return [left_s / 1000.0, view.time_s / 1000.0]
