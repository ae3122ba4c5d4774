"""Plans of fleets that know all demand beforehand, and what no plan can beat."""
