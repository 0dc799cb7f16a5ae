"""Configuration of the sunlight and of its reflection by the chief."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field, model_validator

from safe_inspect.geometry.light import Colour, Light, binary_light, phong_light
from safe_inspect.tasks.inspection.sun import SunDirection
from safe_inspect.units import Length, NonNegativeLength, PositiveAngularRate, PositiveLength


class LightProperties(BaseModel):
    """Intensity of the sunlight by red, green and blue [-]."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    ambient: Colour = (1.0, 1.0, 1.0)
    diffuse: Colour = (1.0, 1.0, 1.0)
    specular: Colour = (1.0, 1.0, 1.0)


class SurfaceProperties(BaseModel):
    """Reflection of light by the chief's surface, by red, green and blue [-].

    Attributes:
        ambient: Fraction of the ambient light.
        diffuse: Fraction that is scattered.
        specular: Fraction that is mirrored.
        shininess: Sharpness of the highlight; the exponent is a quarter of it.
        reflection: Fraction reflected to other surfaces; no effect, because a single sphere has none.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    ambient: Colour = (0.1, 0.0, 0.0)
    diffuse: Colour = (0.7, 0.0, 0.0)
    specular: Colour = (1.0, 1.0, 1.0)
    shininess: float = Field(default=100.0, gt=0)
    reflection: float = Field(default=0.5, ge=0, le=1)


class IlluminationParams(SunDirection):
    """Properties of the sun and its light.

    Attributes:
        mean_motion: Rate of the sun's angle [rad/s].
        avg_rad_Earth2Sun: Distance of the sun [m]; its rays are parallel on the chief, and the distance only determines
            the penumbra of an eclipse.
        light_properties: Colour of the light.
        chief_properties: Colour of the chief's surface.
        bin_ray_flag: True: a point is lit if its ray to the sun is free, and dark otherwise. False: Blinn-Phong colour.
        ray_offset: Height above the surface at which the ray to the sun starts [m]. 0 is exact; safe-autonomy-sims
            uses 1e-5.
        resolution: Pixels of the camera; recorded, without effect on the simulation.
        focal_length: Focal length of the camera [m]; recorded, without effect on the simulation.
        pixel_pitch: Pixel pitch of the camera [m]; recorded, without effect on the simulation.
        render_flag_3d: Must be false: the simulator does not render; use `safe_inspect.evaluation` instead.
        render_flag_subplots: Must be false, for the same reason.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    mean_motion: PositiveAngularRate = 0.001027
    avg_rad_Earth2Sun: PositiveLength = 150e9  # noqa: N815 - the key of safe-autonomy-sims
    light_properties: LightProperties = LightProperties()
    chief_properties: SurfaceProperties = SurfaceProperties()
    bin_ray_flag: bool = True
    ray_offset: NonNegativeLength = 0.0
    resolution: tuple[int, int] = (200, 200)
    focal_length: Length = 9.6e-3
    pixel_pitch: Length = 5.6e-3
    render_flag_3d: bool = False
    render_flag_subplots: bool = False

    def light(self, radius: float) -> Light:
        """Return the light on a sphere of the given radius [m]."""
        if self.bin_ray_flag:
            return binary_light(radius, self.ray_offset)
        sun, chief = self.light_properties, self.chief_properties
        return phong_light(
            radius,
            light_ambient=sun.ambient,
            light_diffuse=sun.diffuse,
            light_specular=sun.specular,
            chief_ambient=chief.ambient,
            chief_diffuse=chief.diffuse,
            chief_specular=chief.specular,
            shininess=chief.shininess,
            ray_offset=self.ray_offset,
        )

    @model_validator(mode="after")
    def _no_rendering(self) -> IlluminationParams:
        if self.render_flag_3d or self.render_flag_subplots:
            raise ValueError("the simulator does not render; set the render flags to False and plot recorded episodes")
        return self
